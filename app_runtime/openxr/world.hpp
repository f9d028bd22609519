// SPDX-License-Identifier: Apache-2.0
// What all calls share: one lock, the table of handles, and the way in which a call fails.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <string_view>
#include <vector>

#include "api.hpp"
#include "failure.hpp"

namespace sim2vr::openxr {

enum class HandleType : std::uint8_t {
  instance = 1,
  session,
  space,
  action_set,
  action,
  swapchain,
  messenger
};

/// Something that the program has a handle of.
struct Object {
  virtual ~Object() = default;
  std::uint64_t handle = 0;
  std::uint64_t parent = 0;
};

/// A handle is an index, a generation and a type: one that was destroyed never names its
/// successor. Entries with the same parent are a list, so that a program with many handles pays for
/// those that a call concerns.
class Handles {
 public:
  /// `parent`: a living handle, or 0 for an instance.
  std::uint64_t add(HandleType type, std::shared_ptr<Object> object, std::uint64_t parent);
  /// nullptr for a handle that is unknown, destroyed or of another type.
  std::shared_ptr<Object> find(HandleType type, std::uint64_t handle) const;
  /// With everything below it. Allocates nothing.
  void remove(std::uint64_t handle) noexcept;
  /// Living children of a type, in the order in which they were added. `parent`: 0 for instances.
  std::vector<std::shared_ptr<Object>> below(HandleType type, std::uint64_t parent) const;

 private:
  static constexpr std::uint32_t kNone = ~0U;
  struct List {
    std::uint32_t first = kNone;
    std::uint32_t last = kNone;
  };
  struct Entry {
    std::shared_ptr<Object> object;
    std::uint32_t generation = 0;
    HandleType type{};
    std::uint32_t next = kNone;  // with the same parent; of a free entry: the next free one
    std::uint32_t previous = kNone;
    List children;
  };
  const Entry* entry(std::uint64_t handle) const;
  /// nullptr: the parent is no living handle.
  const List* children(std::uint64_t parent) const;
  std::vector<Entry> entries_;
  List instances_;
  std::uint32_t free_ = kNone;
};

using Lock = std::unique_lock<std::mutex>;

struct World {
  std::mutex mutex;
  /// A frame began or ended, a session stopped, or the harness was lost.
  std::condition_variable changed;
  Handles handles;
};
/// Never destroyed: programs call from threads that outlive main().
World& world();

const char* resultName(XrResult result);
/// Writes "sim2vr OpenXR: CALL: RESULT: cause" to standard error, each line once, and hands it to
/// the program's debug messengers. Not under the lock. Throws nothing: without memory the line is
/// written as it is, and messengers hear nothing.
XrResult failed(const char* call, XrResult result, std::string_view cause);
/// One line to standard error, each once.
void report(const std::string& line);

/// The lock, unless this process was forked off the one that made the instance (Failure).
Lock enter();
/// Makes calls of forked processes fail, and closes `socket` in them (-1: none).
void watchForks(int socket);

template <class Work>
XrResult guarded(const char* call, Work&& work) {
  // Where no memory is left, the way out must not need any.
  try {
    Lock lock = enter();
    return work(lock);
  } catch (const Failure& failure) {
    return failed(call, failure.result(), failure.what());
  } catch (const std::bad_alloc&) {
    return failed(call, XR_ERROR_OUT_OF_MEMORY, "no memory is left");
  } catch (const std::exception& error) {
    return failed(call, XR_ERROR_RUNTIME_FAILURE, error.what());
  }
}

template <class Handle>
std::uint64_t number(Handle handle) {
  return reinterpret_cast<std::uint64_t>(handle);
}

/// The object of a handle. Throws Failure (XR_ERROR_HANDLE_INVALID).
template <class T, class Handle>
std::shared_ptr<T> get(Handle handle, const char* what) {
  auto object = std::static_pointer_cast<T>(world().handles.find(T::kType, number(handle)));
  if (!object) {
    throw Failure(XR_ERROR_HANDLE_INVALID,
                  std::string(what) + (number(handle) == 0 ? " is XR_NULL_HANDLE"
                                                           : " is no living handle of its type"));
  }
  return object;
}

template <class Handle, class T>
Handle add(const std::shared_ptr<T>& object, std::uint64_t parent) {
  return reinterpret_cast<Handle>(world().handles.add(T::kType, object, parent));
}

}  // namespace sim2vr::openxr
