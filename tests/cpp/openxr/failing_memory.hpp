// SPDX-License-Identifier: Apache-2.0
// Memory that runs out: from the n-th allocation of this process on, operator new throws.
#pragma once

namespace sim2vr::openxr::test {

class FailingMemory {
 public:
  /// `after`: allocations that still succeed, of all threads together.
  explicit FailingMemory(long after);
  ~FailingMemory();
  FailingMemory(const FailingMemory&) = delete;
  FailingMemory& operator=(const FailingMemory&) = delete;
  /// Allocations of this thread since one of these was made.
  static long ofThisThread();
  /// Whether memory has run out.
  static bool ranOut();
};

}  // namespace sim2vr::openxr::test
