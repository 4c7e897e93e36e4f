#include "core/log.h"

#include <cstdio>
#include <mutex>
#include <string>

namespace handhold {
namespace {

std::mutex outputMutex;    // guards stderr and progressLine
std::string progressLine;  // what stands on the terminal's last line

void erase() {
  if (!progressLine.empty()) std::fputs("\r\033[K", stderr);
}

void writeLine(std::string_view prefix, std::string_view text) {
  const std::lock_guard lock(outputMutex);
  erase();
  std::string line(prefix);
  line += text;
  line += '\n';
  std::fwrite(line.data(), 1, line.size(), stderr);
  if (!progressLine.empty()) std::fputs(progressLine.c_str(), stderr);
}

}  // namespace

void logError(std::string_view text) { writeLine("error: ", text); }
void logWarning(std::string_view text) { writeLine("warning: ", text); }
void logInfo(std::string_view text) { writeLine("", text); }

void setProgressLine(std::string_view text) {
  const std::lock_guard lock(outputMutex);
  erase();
  progressLine = text;
  std::fputs(progressLine.c_str(), stderr);
  std::fflush(stderr);
}

}  // namespace handhold
