// Threads that share out one piece of work at a time.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace sim2vr::server {

class WorkerPool {
 public:
  /// `workers` in all; the calling thread of run() is worker 0.
  explicit WorkerPool(int workers);
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  int workers() const { return static_cast<int>(threads_.size()) + 1; }
  /// Calls work(worker) once for every worker, at the same time, and returns when all are done. The
  /// work must not throw.
  void run(const std::function<void(int)>& work);

 private:
  void serve(int worker);

  std::vector<std::thread> threads_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::condition_variable done_;
  const std::function<void(int)>* work_ = nullptr;
  int round_ = 0;
  int busy_ = 0;
  bool stopping_ = false;
};

}  // namespace sim2vr::server
