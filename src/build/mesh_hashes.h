#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace handhold {

/// The hash of a mesh file's bytes; empty when it cannot be read: loading it will say why.
std::string meshHash(const std::string& path);

/// Hashes of mesh files, remembered between runs in `DIR/mesh-hashes.txt`: a file is read again only when its size or
/// one of its times (modified, changed) is another. The cache can be deleted; one that is damaged counts as empty.
/// @note Not thread safe. Builders on one folder may lose each other's newest entries, never more.
class MeshHashes {
 public:
  /// @param settleSeconds  a file that was written less than this before it is hashed is not remembered: it could be
  ///                       written again within one tick of its clock (a network file system's, at worst)
  explicit MeshHashes(const std::filesystem::path& folder, double settleSeconds = 3);

  /// meshHash(path)
  std::string of(const std::string& path);

  /// Writes what was learned, together with what others wrote meanwhile; nothing when there is nothing new. A cache
  /// that cannot be written is a warning.
  void save();

 private:
  struct Entry {
    std::string hash;
    long long bytes = 0, modified = 0, changed = 0;  // ns since 1970
  };
  using Entries = std::map<std::string, Entry>;  // by absolute path
  static Entries read(const std::filesystem::path& file);

  std::filesystem::path file_;
  long long settleTime_;  // ns
  Entries entries_, learned_;
};

}  // namespace handhold
