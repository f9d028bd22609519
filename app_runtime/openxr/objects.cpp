// SPDX-License-Identifier: Apache-2.0
#include "objects.hpp"

#include <fmt/format.h>
#include <openxr/openxr_reflection.h>
#include <pthread.h>
#include <unistd.h>
#include <cstdio>
#include <utility>

#include "check.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::uint64_t kIndexBits = 24;
constexpr std::size_t kMaximumObjects = 1U << 20U;

std::uint32_t indexOf(std::uint64_t handle) {
  return static_cast<std::uint32_t>((handle >> 8U) & ((1U << kIndexBits) - 1U));
}

constexpr std::size_t kMaximumLines = 200;

std::atomic<bool> forked{false};
std::atomic<int> socket_of_parent{-1};

void afterFork() {
  forked = true;
  if (const int socket = socket_of_parent.exchange(-1); socket >= 0) ::close(socket);
}

/// Calls the messengers that want errors. They may call OpenXR: not under the lock.
void tellMessengers(const char* call, const std::string& cause) {
  constexpr XrFlags64 kError = XR_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
  constexpr XrFlags64 kValidation = XR_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT;
  std::vector<std::shared_ptr<Object>> messengers;
  {
    const Lock lock(world().mutex);
    for (const auto& instance : world().handles.below(HandleType::instance, 0)) {
      const auto own = world().handles.below(HandleType::messenger, instance->handle);
      messengers.insert(messengers.end(), own.begin(), own.end());
    }
  }
  for (const auto& object : messengers) {
    const auto& messenger = static_cast<const Messenger&>(*object);
    if ((messenger.severities & kError) == 0 || (messenger.types & kValidation) == 0) continue;
    XrDebugUtilsMessengerCallbackDataEXT data{};
    data.type = XR_TYPE_DEBUG_UTILS_MESSENGER_CALLBACK_DATA_EXT;
    data.messageId = "sim2vr";
    data.functionName = call;
    data.message = cause.c_str();
    messenger.callback(kError, kValidation, &data, messenger.user_data);
  }
}

}  // namespace

World& world() {
  static auto* instance = new World;
  return *instance;
}

std::uint64_t Handles::add(HandleType type, std::shared_ptr<Object> object, std::uint64_t parent) {
  if (children(parent) == nullptr) {
    throw Failure(XR_ERROR_HANDLE_INVALID, "the parent is no living handle");
  }
  std::uint32_t index = free_;
  if (index != kNone) {
    free_ = entries_[index].next;
  } else if (entries_.size() < kMaximumObjects) {
    index = static_cast<std::uint32_t>(entries_.size());
    entries_.emplace_back();
  } else {
    throw Failure(XR_ERROR_LIMIT_REACHED, "more than 1048576 objects are alive");
  }
  auto& siblings = const_cast<List&>(*children(parent));
  Entry& entry = entries_[index];
  ++entry.generation;
  entry.type = type;
  entry.next = kNone;
  entry.previous = siblings.last;
  (siblings.last == kNone ? siblings.first : entries_[siblings.last].next) = index;
  siblings.last = index;
  const std::uint64_t handle = static_cast<std::uint64_t>(entry.generation) << 32U |
                               static_cast<std::uint64_t>(index) << 8U |
                               static_cast<std::uint64_t>(type);
  object->handle = handle;
  object->parent = parent;
  entry.object = std::move(object);
  return handle;
}

const Handles::Entry* Handles::entry(std::uint64_t handle) const {
  const std::uint32_t index = indexOf(handle);
  if (index >= entries_.size()) return nullptr;
  const Entry& found = entries_[index];
  return found.object && found.object->handle == handle ? &found : nullptr;
}

std::shared_ptr<Object> Handles::find(HandleType type, std::uint64_t handle) const {
  const Entry* found = entry(handle);
  return found != nullptr && found->type == type ? found->object : nullptr;
}

const Handles::List* Handles::children(std::uint64_t parent) const {
  if (parent == 0) return &instances_;
  const Entry* found = entry(parent);
  return found != nullptr ? &found->children : nullptr;
}

void Handles::remove(std::uint64_t handle) noexcept {
  if (entry(handle) == nullptr) return;
  const std::uint32_t index = indexOf(handle);
  Entry& gone = entries_[index];
  while (gone.children.first != kNone) remove(entries_[gone.children.first].object->handle);
  auto& siblings = const_cast<List&>(*children(gone.object->parent));
  (gone.previous == kNone ? siblings.first : entries_[gone.previous].next) = gone.next;
  (gone.next == kNone ? siblings.last : entries_[gone.next].previous) = gone.previous;
  gone.next = std::exchange(free_, index);
  const std::shared_ptr<Object> last = std::exchange(gone.object, nullptr);
}

std::vector<std::shared_ptr<Object>> Handles::below(HandleType type, std::uint64_t parent) const {
  std::vector<std::shared_ptr<Object>> found;
  const List* of_parent = children(parent);
  if (of_parent == nullptr) return found;
  for (std::uint32_t i = of_parent->first; i != kNone; i = entries_[i].next) {
    if (entries_[i].type == type) found.push_back(entries_[i].object);
  }
  return found;
}

// How calls fail: one line on standard error, and the program's debug messengers.

const char* resultName(XrResult result) {
  switch (result) {
#define SIM2VR_RESULT(name, number) \
  case name:                        \
    return #name;
    XR_LIST_ENUM_XrResult(SIM2VR_RESULT)
#undef SIM2VR_RESULT
        default : break;
  }
  if (result == kDependencyNotEnabled) return "XR_ERROR_EXTENSION_DEPENDENCY_NOT_ENABLED";
  if (result == kPermissionInsufficient) return "XR_ERROR_PERMISSION_INSUFFICIENT";
  return nullptr;
}

void report(const std::string& line) {
  static auto* mutex = new std::mutex;
  static auto* lines = new std::set<std::string>;
  const std::lock_guard lock(*mutex);
  if (lines->size() >= kMaximumLines || !lines->insert(line).second) return;
  std::fprintf(stderr, "%s\n", line.c_str());
  std::fflush(stderr);
}

XrResult failed(const char* call, XrResult result, std::string_view cause) {
  const char* name = resultName(result);
  if (name == nullptr) name = "?";
  try {
    report(fmt::format("sim2vr OpenXR: {}: {}: {}", call, name, cause));
    if (!forked) tellMessengers(call, std::string(cause));
  } catch (const std::exception&) {
    std::fprintf(stderr, "sim2vr OpenXR: %s: %s: %.*s\n", call, name,
                 static_cast<int>(cause.size()), cause.data());
  }
  return result;
}

Lock enter() {
  if (forked) {
    throw Failure(XR_ERROR_RUNTIME_FAILURE,
                  "this process was forked off the one that made the instance; only that one can "
                  "go on");
  }
  return Lock(world().mutex);
}

void watchForks(int socket) {
  static std::atomic<bool> watching{false};
  if (socket >= 0) socket_of_parent = socket;
  if (!watching.exchange(true)) ::pthread_atfork(nullptr, nullptr, &afterFork);
}

// What the functions of graphics extensions ask of the core.

XrResult graphicsCall(const char* call, XrInstance instance, XrSystemId system,
                      std::string_view extension) {
  return guarded(call, [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    if (!owner->enabled(extension)) {
      throw Failure(XR_ERROR_FUNCTION_UNSUPPORTED, fmt::format("{} is not enabled", extension));
    }
    if (system != kSystem || !owner->system_asked) {
      throw Failure(XR_ERROR_SYSTEM_INVALID, fmt::format("no system {}", system));
    }
    owner->requirements_asked.emplace(call);
    return XR_SUCCESS;
  });
}

XrResult graphicsFailed(const char* call, XrResult result, std::string_view cause) {
  return failed(call, result, cause);
}

}  // namespace sim2vr::openxr
