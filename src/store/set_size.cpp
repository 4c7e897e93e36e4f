#include "store/set_size.h"

#include "store/layout.h"

namespace handhold {

SetSize sizeOf(const GraspSet& set, std::size_t fileBytes) {
  SetSize size;
  forEachArray([&](std::string_view, auto member, std::string_view symbols) {
    const auto bytes = static_cast<double>((set.*member).size() * sizeof((set.*member)[0]));
    if (symbols == "NRM") {
      size.perTrial += bytes;
    } else if (symbols[0] == 'N' || symbols[0] == 'S') {
      size.perSample += bytes;
    } else {
      size.perGrasp += bytes;
    }
  });
  size.fixed = static_cast<double>(fileBytes) - size.perTrial - size.perSample - size.perGrasp;
  const auto each = [](double bytes, std::size_t count) { return count > 0 ? bytes / static_cast<double>(count) : 0; };
  size.perTrial = each(size.perTrial, set.trialCount());
  size.perSample = each(size.perSample, set.samples);
  size.perGrasp = each(size.perGrasp, set.graspCount());
  return size;
}

}  // namespace handhold
