// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as a study file: refused with an error, or a study whose candidates have finite values within their ranges.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "polypod/design/study.hpp"
#include "require.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace polypod;
  using fuzz::require;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto study = design::study_from_text(text, "fuzz.toml");
  if (!study) return fuzz::require_error(study.error()), 0;
  require(!study->vary.empty() && !study->goals.empty(), "something varies and something is wanted");
  require(study->evaluations >= 1 && study->resolution >= 8, "a study can be worked on");
  std::vector<double> middle;
  for (const design::Vary& v : study->vary) {
    for (const double u : {-1.0, 0.0, 0.3, 1.0, 2.0}) {
      const double x = v.at(u);
      require(std::isfinite(x) && x >= v.min && x <= v.max, "a value lies in its range");
      const double share = v.share_of(x);
      require(share >= 0 && share <= 1, "a share is one");
    }
    middle.push_back(v.at(0.5));
  }
  require(study->parameters(middle).size() == study->vary.size() + study->ties.size(), "every key has a value");
  require(!study->identity().empty(), "a study has an identity");
  (void)study->machine_at(middle);
  return 0;
}
