#include "build/checkpoint.h"

#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "core/log.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <string_view>
#include <type_traits>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kMagic = "HANDHOLD CHUNK 2\n";

/// Writes numbers one after another, or reads them back in the same order.
class Archive {
 public:
  Archive() = default;
  explicit Archive(std::string_view bytes) : reads_(true), left_(bytes) {}

  template <class T>
  void number(T& value) {
    static_assert(std::is_arithmetic_v<T>);
    if (!reads_) {
      bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    } else if (left_.size() >= sizeof value) {
      std::memcpy(&value, left_.data(), sizeof value);
      left_.remove_prefix(sizeof value);
    } else {
      good_ = false;
    }
  }
  template <class Numbers>
  void numbers(Numbers&& values) {
    for (auto& value : values) number(value);
  }
  /// A length that the bytes cannot hold is none.
  template <class Array>
  void length(Array& array) {
    auto count = static_cast<std::uint64_t>(array.size());
    number(count);
    if (!reads_) return;
    good_ = good_ && count <= left_.size();
    array.resize(good_ ? count : 0);
  }

  const std::string& bytes() const { return bytes_; }
  bool isWholeAndGood() const { return good_ && left_.empty(); }

 private:
  bool reads_ = false, good_ = true;
  std::string_view left_;
  std::string bytes_;
};

void visit(Archive& archive, KeptGrasp& grasp) {
  archive.number(grasp.trial);
  archive.number(grasp.epsilon);
  archive.numbers(grasp.X_OH.matrix().reshaped());
  archive.number(grasp.backoff);
  archive.number(grasp.approachClear);
  archive.numbers(grasp.centering);
  archive.length(grasp.jointPosition);
  archive.numbers(grasp.jointPosition);
  archive.length(grasp.contacts);
  for (Contact& contact : grasp.contacts) {
    archive.numbers(contact.position);
    archive.numbers(contact.normal);
    archive.number(contact.link);
  }
}

void visit(Archive& archive, SampleResults& sample) {
  archive.length(sample.outcome);
  archive.numbers(sample.outcome);
  archive.length(sample.epsilon);
  archive.numbers(sample.epsilon);
  archive.length(sample.grasps);
  for (KeptGrasp& grasp : sample.grasps) visit(archive, grasp);
  archive.number(sample.byReference);
  for (double* seconds :
       {&sample.seconds.policy, &sample.seconds.forceClosure, &sample.seconds.epsilon, &sample.seconds.approach})
    archive.number(*seconds);
}

}  // namespace

Checkpoint::Checkpoint(const fs::path& folder, const std::string& inputHash, std::size_t trialsPerChunk)
    : folder_(folder / (std::string(kChunksPrefix) + inputHash)), trialsPerChunk_(trialsPerChunk) {}

fs::path Checkpoint::path(std::size_t chunk) const { return folder_ / fmt::format("{:06}", chunk); }

bool Checkpoint::read(std::size_t chunk, std::size_t trialsPerSample, std::span<SampleResults> samples) const {
  std::error_code error;
  if (!fs::exists(path(chunk), error)) return false;
  try {
    const std::string file = readFile(path(chunk));
    const std::string_view text = file;
    const std::size_t begin = kMagic.size() + kHashLength;
    if (text.size() < begin || text.substr(0, kMagic.size()) != kMagic) return false;
    const std::string_view body = text.substr(begin);
    if (text.substr(kMagic.size(), kHashLength) != hashBytes(body.data(), body.size())) return false;
    Archive archive(body);
    std::vector<SampleResults> results(samples.size());
    for (SampleResults& sample : results) visit(archive, sample);
    const bool fits = std::all_of(results.begin(), results.end(), [&](const SampleResults& sample) {
      return sample.outcome.size() == trialsPerSample && sample.epsilon.size() == trialsPerSample;
    });
    if (!archive.isWholeAndGood() || !fits) return false;
    std::move(results.begin(), results.end(), samples.begin());
    return true;
  } catch (const InputError&) {
    return false;
  }
}

void Checkpoint::write(std::size_t chunk, std::span<SampleResults> samples) const {
  Archive archive;
  for (SampleResults& sample : samples) visit(archive, sample);
  std::error_code error;
  // Once: a database that vanishes while the set is built is not begun anew for the sake of chunks.
  std::call_once(made_, [&] { fs::create_directories(folder_.parent_path(), error); });
  fs::create_directory(folder_, error);
  const fs::path temporary = temporaryName(folder_);
  std::ofstream stream(temporary, std::ios::binary);
  stream << kMagic << hashBytes(archive.bytes().data(), archive.bytes().size()) << archive.bytes();
  stream.close();
  fs::rename(temporary, path(chunk), error);
  if (stream && !error) return;
  fs::remove(temporary, error);
  if (!warned_.exchange(true))
    logWarning(fmt::format("{}: finished trials cannot be written there; a build that is stopped begins anew",
                           folder_.string()));
}

void Checkpoint::remove() const {
  std::error_code error;
  fs::remove_all(folder_, error);
}

}  // namespace handhold
