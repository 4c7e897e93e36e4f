#pragma once

#include "core/error.h"

#include <string>

namespace handhold {

/// What the InputError of a call says; `accepted` when there is none.
template <class Call>
std::string refusalOf(const Call& call) {
  try {
    call();
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace handhold
