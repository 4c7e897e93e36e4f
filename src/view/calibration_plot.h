#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace handhold {

/// The ROC curve of one model: (false positive rate, true positive rate), from (0, 0) to (1, 1).
struct RocSeries {
  std::string name;
  std::vector<std::array<double, 2>> points;
};

/// ROC curves as SVG text, with the diagonal of a guess. At most four.
std::string rocSvg(const std::string& title, const std::vector<RocSeries>& series);

/// What became of the predictions in the bins of one model.
struct ReliabilityPanel {
  struct Bin {
    double middle = 0;                    // of the bin
    double predicted = 0;                 // mean of the probabilities
    double share = 0, low = 0, high = 0;  // that came true, and its 95 % interval
    std::size_t count = 0;                // of predictions, > 0
  };
  std::string name;
  std::vector<Bin> bins;
};

/// A reliability diagram as SVG text, a panel a model: the share that came true over the probability, with its interval
/// and below it the number of predictions of each bin. On the diagonal probabilities are what they say.
std::string reliabilitySvg(const std::string& title, const std::vector<ReliabilityPanel>& panels);

}  // namespace handhold
