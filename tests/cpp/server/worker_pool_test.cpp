#include "worker_pool.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace sim2vr::server {
namespace {

TEST(WorkerPool, EveryWorkerWorksOnceARound) {
  for (const int workers : {1, 3}) {
    WorkerPool pool(workers);
    ASSERT_EQ(pool.workers(), workers);
    std::vector<int> rounds(static_cast<std::size_t>(workers), 0);
    for (int round = 0; round < 500; ++round) {
      pool.run([&rounds](int worker) { ++rounds[static_cast<std::size_t>(worker)]; });
    }
    EXPECT_EQ(rounds, std::vector<int>(static_cast<std::size_t>(workers), 500));
  }
}

}  // namespace
}  // namespace sim2vr::server
