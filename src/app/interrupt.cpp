#include "app/commands.h"

#include <csignal>

namespace handhold {
namespace {

std::atomic<bool> stopRequested{false};

/// The first signal asks for an orderly stop; the second ends the program as usual.
extern "C" void requestStop(int signal) {
  stopRequested = true;
  std::signal(signal, SIG_DFL);
}

}  // namespace

const std::atomic<bool>& stopOnSignals() {
  std::signal(SIGINT, requestStop);
  std::signal(SIGTERM, requestStop);
  return stopRequested;
}

}  // namespace handhold
