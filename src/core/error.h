#pragma once

#include <stdexcept>
#include <string>

namespace handhold {

/// Wrong input from outside: a file, a job, an argument. The text is one line that names the input, the value found and
/// the value wanted. Whoever processes a batch records it for the item and goes on; a program exits with 2.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The machine refused: disk full, no permission, out of file handles. The text is one line with the path and the
/// reason.
class SystemError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace handhold
