#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace handhold {

/// The whole file. Throws InputError: `PATH: cannot be read: REASON`.
std::string readFile(const std::filesystem::path& path);

/// `target` becomes the content of the finished temporary file `temporary` (same folder): fsync, link(2), unlink,
/// fsync of the folder. An existing `target` is left as it is and false returned; the temporary file is gone either
/// way. Throws SystemError on any other refusal.
bool publishFile(const std::filesystem::path& temporary, const std::filesystem::path& target);

/// `target` becomes `content` at once: whoever reads it finds the old or the new. For files that can be made again:
/// they are not brought to the disk. Throws SystemError.
void replaceContent(const std::filesystem::path& target, std::string_view content);

/// As publishFile, but an existing `target` is replaced in one step: readers see the old file or the new one.
void replaceFile(const std::filesystem::path& temporary, const std::filesystem::path& target);

/// Creates the folder and those above it. @throws SystemError  `PATH: cannot be created: REASON`
void createFolders(const std::filesystem::path& folder);

/// A folder that is kept open: no other gets its number on the disk meanwhile, so that one can tell whether a path
/// still leads to it.
class OpenFolder {
 public:
  /// What cannot be opened is nowhere known.
  explicit OpenFolder(const std::filesystem::path& path);
  ~OpenFolder();
  OpenFolder(const OpenFolder&) = delete;
  OpenFolder& operator=(const OpenFolder&) = delete;

  /// False when the path leads elsewhere or nowhere; true when the folder is not known.
  bool isAt(const std::filesystem::path& path) const;

 private:
  int descriptor_;
};

/// A name that is free in `folder`, starts with a dot and is unique to this process and call.
std::filesystem::path temporaryName(const std::filesystem::path& folder);

/// How folders with the finished parts of what is still being built begin.
inline constexpr std::string_view kChunksPrefix = ".chunks-";

/// True for a file that temporaryName named and nobody will finish: its process is gone from this machine, or it has
/// not been written to for six hours; and for a folder of chunks that has not been for as long.
bool isAbandonedTemporary(const std::filesystem::path& path);

/// True when `text` matches a shell pattern of *, ? and [...]; none of them matches a slash.
bool matchesGlob(std::string_view text, std::string_view pattern);

/// Object and hand names become folder names. Throws InputError unless `name` is 1 to 100 letters, digits, '.', '_',
/// '-' or '+' and starts with a letter or digit. `where` begins the message (file and line).
void requireName(std::string_view name, std::string_view where, std::string_view what);

/// Replaces every ${NAME} by the environment variable. Throws InputError naming an unset one.
std::string expandEnvironment(std::string_view text, std::string_view where);

/// `word` as a shell takes it for one word: in single quotes unless it needs none.
std::string shellQuoted(const std::string& word);

/// The folder of the running program.
std::filesystem::path programFolder();

}  // namespace handhold
