// SPDX-License-Identifier: Apache-2.0
// How calls fail: one line on standard error, and the program's debug messengers.
#include <fmt/format.h>
#include <openxr/openxr_reflection.h>
#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <set>

#include "objects.hpp"

namespace sim2vr::openxr {
namespace {

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

}  // namespace sim2vr::openxr
