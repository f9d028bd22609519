// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/text.hpp"

#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {
namespace {

constexpr std::size_t kMaximumFileBytes = std::size_t{256} << 20;

}  // namespace

std::string readTextFile(std::string_view field, const std::filesystem::path& path,
                         std::string_view expected) {
  const auto refuse = [&](const std::string& why) {
    throw InvalidArgument(field, "'" + printable(path.string()) + "' (" + why + ")", expected);
  };
  std::error_code ignored;
  const std::filesystem::file_status status = std::filesystem::status(path, ignored);
  if (std::filesystem::is_directory(status)) refuse("a folder");
  // Opening a pipe waits for its writer.
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    refuse("not a regular file");
  }
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  if (!file) refuse(errno == 0 ? "cannot be opened" : std::strerror(errno));
  std::string text;
  char block[65536];
  while (file.read(block, sizeof(block)) || file.gcount() > 0) {
    text.append(block, static_cast<std::size_t>(file.gcount()));
    if (text.size() > kMaximumFileBytes) refuse("above 256 MiB");
  }
  if (file.bad()) refuse("cannot be read");
  if (text.empty()) refuse("empty");
  return text;
}

std::string pathFromUri(std::string_view field, std::string_view text) {
  constexpr std::string_view kScheme = "file:";
  if (!text.starts_with(kScheme)) return std::string(text);
  const auto refuse = [&] {
    throw InvalidArgument(field, "'" + printable(text) + "'",
                          "a URI of a file on this machine, such as file:///maps/M%E4use");
  };
  std::string_view coded = text.substr(kScheme.size());
  if (coded.starts_with("///")) coded.remove_prefix(2);
  if (!coded.starts_with('/') || coded.starts_with("//")) refuse();
  std::string path;
  for (std::size_t i = 0; i < coded.size(); ++i) {
    unsigned char byte = static_cast<unsigned char>(coded[i]);
    if (coded[i] == '%') {
      const char* digits = coded.data() + i + 1;
      const bool whole = i + 2 < coded.size();
      if (!whole || std::from_chars(digits, digits + 2, byte, 16).ptr != digits + 2) refuse();
      if (byte == 0) refuse();
      i += 2;
    }
    path += static_cast<char>(byte);
  }
  return path;
}

std::string validUtf8(std::string_view text) {
  using Json = nlohmann::json;
  const std::string quoted = Json(text).dump(-1, ' ', false, Json::error_handler_t::replace);
  return Json::parse(quoted).get<std::string>();
}

std::string printable(std::string_view text, std::size_t limit) {
  using Json = nlohmann::json;
  // JSON's words for control characters, and nothing but ASCII.
  std::string quoted =
      Json(text.substr(0, limit)).dump(-1, ' ', true, Json::error_handler_t::replace);
  quoted = quoted.substr(1, quoted.size() - 2);
  for (std::size_t at = 0; (at = quoted.find('\x7f', at)) != std::string::npos;) {
    quoted.replace(at, 1, "\\u007f");
  }
  return text.size() > limit ? quoted + "..." : quoted;
}

}  // namespace sim2vr
