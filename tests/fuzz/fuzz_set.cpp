// Any first bytes, and any numbers and texts under checksums that fit them, as a grasp set: a set that contradicts
// nothing, or an InputError of one line.
//
// The first byte says which: 0, the rest stands in the place of a good file's first bytes; else the rest is a list of
// edits (two bytes of position, one of value) of what a good file stores, and the checksums are made right. HDF5's own
// structures are left alone there: it is not safe on forged ones, and db/FORMAT.md says so.
#include "core/hash.h"
#include "fuzz/one_line.h"
#include "store/database.h"
#include "store/layout.h"
#include "store/synthetic_set.h"

#include <cstring>

#include <fmt/format.h>
#include <sys/mman.h>
#include <unistd.h>

namespace handhold {
namespace {

/// A good file, and where in it each number and letter lies that a reader may meet.
struct GoodSet {
  GraspSet set = syntheticSet();
  std::string bytes;
  std::vector<std::size_t> positions;

  GoodSet() {
    set.setVersion = 1;
    bytes = encodeGraspSet(set);
    forEachArray([&](const char*, auto member, std::string_view) {
      const auto& values = set.*member;
      add({reinterpret_cast<const char*>(values.data()), values.size() * sizeof values[0]});
    });
    forEachText([&](const char*, auto member) { add(set.*member); });
    forEachTexts([&](const char*, auto member) {
      for (const std::string& text : set.*member) add(text);
    });
    forEachRootAttribute([&](const std::string&, auto member) {
      if constexpr (std::is_same_v<decltype(member), std::string GraspSet::*>) {
        add(set.*member);
      } else {
        add({reinterpret_cast<const char*>(&(set.*member)), sizeof(set.*member)});
      }
    });
  }

  /// Only content that is found once is surely what it looks like.
  void add(std::string_view content) {
    const std::size_t at = content.empty() ? std::string::npos : bytes.find(content, kBlockBytes);
    if (at == std::string::npos || bytes.find(content, at + 1) != std::string::npos) return;
    for (std::size_t i = 0; i < content.size(); ++i) positions.push_back(at + i);
  }
};

const GoodSet& goodSet() {
  static const GoodSet good;
  return good;
}

std::string withFirstBytes(std::string_view first) {
  std::string bytes = goodSet().bytes;
  std::copy_n(first.begin(), std::min(first.size(), bytes.size()), bytes.begin());
  return bytes;
}

std::string withEdits(std::string_view edits) {
  const GoodSet& good = goodSet();
  std::string image = good.bytes;
  for (; edits.size() >= 3; edits.remove_prefix(3)) {
    std::uint16_t position = 0;
    std::memcpy(&position, edits.data(), sizeof position);
    image[good.positions[position % good.positions.size()]] = edits[2];
  }
  image.erase(0, kBlockBytes);
  const GraspSet& set = good.set;
  SetBlock block{set.object,    set.hand,     set.setVersion,
                 set.inputHash, image.size(), hashBytes(image.data(), image.size())};
  return encodeBlock(block) + image;
}

template <class Read>
void read(const Read& reader) {
  try {
    reader();
  } catch (const InputError& error) {
    fuzz::requireOneLine(error);
  }
}

/// Through a file in memory: the readers take paths.
void readSet(const std::string& bytes) {
  const int file = ::memfd_create("set", MFD_CLOEXEC);
  if (file < 0 || ::write(file, bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size())) std::abort();
  const std::string path = fmt::format("/proc/self/fd/{}", file);
  read([&] { readInputHash(path); });
  read([&] { readSummary(path); });
  read([&] { readGraspTable(path); });
  read([&] { encodeGraspSet(readGraspSet(path)); });
  ::close(file);
}

}  // namespace
}  // namespace handhold

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  handhold::readSet(data[0] == 0 ? handhold::withFirstBytes(rest) : handhold::withEdits(rest));
  return 0;
}
