// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <atomic>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/runtime/thread_pool.hpp"

namespace sim2vr::runtime {
namespace {

TEST(ThreadPool, EveryThreadGetsItsShareEveryTime) {
  for (const int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    EXPECT_EQ(pool.threads(), threads);
    std::vector<int> calls(static_cast<std::size_t>(threads), 0);
    for (int round = 0; round < 200; ++round) {
      pool.run([&](int index) { ++calls[static_cast<std::size_t>(index)]; });
    }
    EXPECT_EQ(calls, std::vector<int>(static_cast<std::size_t>(threads), 200));
  }
}

TEST(ThreadPool, ThreadsStayTheSame) {
  ThreadPool pool(3);
  std::vector<std::thread::id> first(3);
  std::vector<std::thread::id> second(3);
  pool.run([&](int i) { first[static_cast<std::size_t>(i)] = std::this_thread::get_id(); });
  pool.run([&](int i) { second[static_cast<std::size_t>(i)] = std::this_thread::get_id(); });
  EXPECT_EQ(first, second);
  EXPECT_EQ(first.back(), std::this_thread::get_id());
  EXPECT_EQ(std::set<std::thread::id>(first.begin(), first.end()).size(), 3U);
}

TEST(ThreadPool, AFailureWaitsForTheOthersAndTheLowestIsReported) {
  ThreadPool pool(4);
  std::atomic<int> finished = 0;
  try {
    pool.run([&](int index) {
      if (index == 1 || index == 2) throw std::runtime_error(std::to_string(index));
      ++finished;
    });
    FAIL() << "nothing was thrown";
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "1");
  }
  EXPECT_EQ(finished, 2);
  pool.run([&](int) { ++finished; });
  EXPECT_EQ(finished, 6);
}

TEST(ThreadPool, NeedsAThread) {
  try {
    ThreadPool pool(0);
    FAIL() << "nothing was thrown";
  } catch (const InvalidArgument& error) {
    EXPECT_STREQ(error.what(), "threads: got 0, expected 1 or more");
  }
}

}  // namespace
}  // namespace sim2vr::runtime
