// SPDX-License-Identifier: Apache-2.0
// The short pass: every target on its corpus and on some thousand mutations of it, always the same.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <ostream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "sim2vr/runtime/app.hpp"
#include "targets.hpp"

namespace sim2vr::fuzz {
namespace {

/// Of each target; SIM2VR_MUTATIONS asks for more, where there is no libFuzzer.
int mutations() {
  const char* wanted = std::getenv("SIM2VR_MUTATIONS");
  return wanted == nullptr ? 3000 : std::atoi(wanted);
}

std::vector<std::string> readCorpus(std::string_view target) {
  const auto folder =
      std::filesystem::path(SIM2VR_SOURCE_DIR) / "tests" / "fuzz" / "corpus" / target;
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  std::vector<std::string> inputs;
  for (const auto& path : paths) {
    std::ifstream file(path, std::ios::binary);
    inputs.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return inputs;
}

class Mutator {
 public:
  explicit Mutator(const std::vector<std::string>& corpus) : corpus_(corpus) {}

  std::string next() {
    std::string input = corpus_[below(corpus_.size())];
    const std::size_t changes = 1 + below(4);
    for (std::size_t i = 0; i < changes; ++i) change(input);
    return input;
  }

 private:
  // std::uniform_int_distribution differs between libraries.
  std::size_t below(std::size_t limit) { return limit == 0 ? 0 : bits_() % limit; }

  void change(std::string& input) {
    const std::size_t at = below(input.size());
    switch (below(6)) {
      case 0:
        if (!input.empty()) input[at] = static_cast<char>(input[at] ^ (1 << below(8)));
        break;
      case 1:
        if (!input.empty()) input[at] = static_cast<char>(below(256));
        break;
      case 2:
        input.insert(at, 1, static_cast<char>(below(256)));
        break;
      case 3:
        input.erase(at, 1 + below(8));
        break;
      case 4:
        input.resize(at);
        break;
      default: {
        const std::string& other = corpus_[below(corpus_.size())];
        const std::size_t from = below(other.size());
        input.insert(at, other.substr(from, 1 + below(64)));
      }
    }
  }

  const std::vector<std::string>& corpus_;
  std::mt19937_64 bits_{1};
};

}  // namespace

void PrintTo(const Target& target, std::ostream* out) { *out << target.name; }

namespace {

class CorpusTest : public ::testing::TestWithParam<Target> {};

TEST_P(CorpusTest, RunsThroughItsCorpusAndMutationsOfIt) {
  const std::vector<std::string> corpus = readCorpus(GetParam().name);
  ASSERT_FALSE(corpus.empty());
  for (const std::string& input : corpus) GetParam().run(input);
  Mutator mutator(corpus);
  for (int i = 0; i < mutations(); ++i) GetParam().run(mutator.next());
}

// An input in an old format is refused at its first byte, and what lies behind is never reached.
TEST(Corpus, IsOfTodaysFormats) {
  for (const std::string& input : readCorpus("protocol2")) {
    std::string_view left = input;
    const std::vector<std::string_view> body = takeFrames(left);
    EXPECT_NO_THROW(
        server::protocol2::decodeRequest(server::protocol2::decodeHeader(body.at(0)), body))
        << "run tests/fuzz/make_corpus.py";
  }
  const auto renderer = render::Renderer::create(render::RendererKind::null);
  for (const auto& [name, settings] :
       {std::pair{"saved_state", hostSettings().app}, std::pair{"saved_beats", beatsSettings()}}) {
    runtime::App app(settings, renderer);
    for (const std::string& state : readCorpus(name)) {
      EXPECT_NO_THROW(app.load(state)) << "run tests/fuzz/make_corpus.py";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Targets, CorpusTest, ::testing::ValuesIn(kTargets),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace sim2vr::fuzz
