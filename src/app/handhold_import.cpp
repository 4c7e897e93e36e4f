// handhold-import PATH SECONDS BYTES TRIANGLES: reads one mesh file with third-party importers, which can crash or
// hang, and writes its triangles to stdout for the process that started it. Not for people.

#include "core/error.h"
#include "mesh/import_file.h"

#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>
#include <ostream>

#include <ext/stdio_filebuf.h>
#include <fcntl.h>
#include <unistd.h>

namespace {

using handhold::ImportExit;

/// Standard output moves to another descriptor: a library that prints must not end up in the data.
int claimOutput() {
  const int output = ::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
  const int nothing = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (output < 0 || nothing < 0 || ::dup2(nothing, STDOUT_FILENO) < 0) throw handhold::SystemError("stdout is closed");
  return output;
}

int fail(ImportExit exit, const char* text) {
  std::fprintf(stderr, "%s\n", text);
  return static_cast<int>(exit);
}

int run(const char* path, const handhold::ImportLimits& limits) {
  try {
    handhold::limitThisProcess(limits);
    __gnu_cxx::stdio_filebuf<char> buffer(claimOutput(), std::ios::out | std::ios::binary);
    std::ostream out(&buffer);
    handhold::importToStream(path, limits.triangles, out);
    return static_cast<int>(ImportExit::good);
  } catch (const handhold::InputError& error) {
    return fail(ImportExit::refused, error.what());
  } catch (const std::bad_alloc&) {
    return fail(ImportExit::outOfMemory, "out of memory");
  } catch (const std::exception& error) {
    return fail(ImportExit::systemError, error.what());
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) return fail(ImportExit::systemError, "usage: handhold-import PATH SECONDS BYTES TRIANGLES");
  handhold::ImportLimits limits;
  limits.seconds = std::strtod(argv[2], nullptr);
  limits.bytes = std::strtoull(argv[3], nullptr, 10);
  limits.triangles = std::strtoull(argv[4], nullptr, 10);
  return run(argv[1], limits);
}
