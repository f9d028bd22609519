// SPDX-License-Identifier: Apache-2.0
// Paths: strings that the specification's rules allow, and the numbers that stand for them.
#include "paths.hpp"

#include <algorithm>

#include "calls.hpp"
#include "check.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::size_t kMaximumPaths = 100'000;

/// "/" and names.
bool isPath(std::string_view text) {
  if (text.size() < 2 || text.front() != '/' || text.back() == '/') return false;
  std::size_t begin = 1;
  while (begin <= text.size()) {
    const std::size_t end = std::min(text.find('/', begin), text.size());
    if (!xr::isName(text.substr(begin, end - begin))) return false;
    begin = end + 1;
  }
  return true;
}

}  // namespace

XrPath toPath(Instance& instance, std::string_view text) {
  const auto found = instance.paths.find(std::string(text));
  if (found != instance.paths.end()) return found->second;
  if (instance.path_texts.size() >= kMaximumPaths) {
    throw Failure(XR_ERROR_PATH_COUNT_EXCEEDED, "100000 paths exist");
  }
  instance.path_texts.emplace_back(text);
  const XrPath path = instance.path_texts.size();
  instance.paths.emplace(text, path);
  return path;
}

const std::string& pathText(const Instance& instance, XrPath path, const char* what) {
  if (path == XR_NULL_PATH || path > instance.path_texts.size()) {
    throw Failure(XR_ERROR_PATH_INVALID,
                  fmt::format("{} is {}, no path of this instance", what, path));
  }
  return instance.path_texts[path - 1];
}

XrResult XRAPI_CALL calls::xrStringToPath(XrInstance instance, const char* pathString,
                                          XrPath* path) {
  return guarded("xrStringToPath", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    requirePointer(pathString, "pathString");
    requirePointer(path, "path");
    const std::string_view text(pathString, ::strnlen(pathString, XR_MAX_PATH_LENGTH + 1));
    if (text.size() >= XR_MAX_PATH_LENGTH || !isPath(text)) {
      throw Failure(XR_ERROR_PATH_FORMAT_INVALID,
                    fmt::format("'{}' is no path", text.substr(0, 80)));
    }
    *path = toPath(*owner, text);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrPathToString(XrInstance instance, XrPath path,
                                          uint32_t bufferCapacityInput, uint32_t* bufferCountOutput,
                                          char* buffer) {
  return guarded("xrPathToString", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    return fillText(pathText(*owner, path, "path"), bufferCapacityInput, bufferCountOutput, buffer);
  });
}

}  // namespace sim2vr::openxr
