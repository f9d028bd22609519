// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/runtime/thread_pool.hpp"

#include <string>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::runtime {

ThreadPool::ThreadPool(int threads) {
  if (threads < 1) throw InvalidArgument("threads", std::to_string(threads), "1 or more");
  failures_.resize(static_cast<std::size_t>(threads));
  for (int i = 0; i + 1 < threads; ++i) workers_.emplace_back([this, i] { loop(i); });
}

ThreadPool::~ThreadPool() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  start_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void ThreadPool::run(const std::function<void(int)>& work) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    work_ = &work;
    running_ = static_cast<int>(workers_.size());
    ++round_;
  }
  start_.notify_all();
  try {
    work(static_cast<int>(workers_.size()));
  } catch (...) {
    failures_.back() = std::current_exception();
  }
  {
    std::unique_lock<std::mutex> lock(mutex_);
    done_.wait(lock, [this] { return running_ == 0; });
  }
  std::exception_ptr first;
  for (std::exception_ptr& failure : failures_) {
    if (failure && !first) first = failure;
    failure = nullptr;
  }
  if (first) std::rethrow_exception(first);
}

void ThreadPool::loop(int index) {
  std::uint64_t seen = 0;
  while (true) {
    const std::function<void(int)>* work = nullptr;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      start_.wait(lock, [&] { return stop_ || round_ != seen; });
      if (stop_) return;
      seen = round_;
      work = work_;
    }
    try {
      (*work)(index);
    } catch (...) {
      failures_[static_cast<std::size_t>(index)] = std::current_exception();
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    if (--running_ == 0) done_.notify_one();
  }
}

}  // namespace sim2vr::runtime
