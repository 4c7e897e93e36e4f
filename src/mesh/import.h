#pragma once

#include "mesh/import_file.h"
#include "mesh/object.h"

#include <string>

namespace handhold {

/// The program that reads mesh files: in $HANDHOLD_LIBEXEC (for programs that use the library), beside the running one,
/// or where an install puts helpers.
/// @throws SystemError  in no such place
std::string importHelper();

/// Runs `helper` on `path` in a child process, with a deadline on the wall clock, and takes over what it read.
/// @throws InputError   the helper refused the file, crashed on it, took too long or more memory than it may
/// @throws SystemError  the helper cannot be started, or answers in another form than ImportHeader's
/// @note   Safe from many threads: no descriptor of one child reaches another.
ImportedMesh importInChild(const std::string& helper, const std::string& path, const ImportLimits& limits);

}  // namespace handhold
