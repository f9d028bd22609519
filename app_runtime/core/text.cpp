#include "sim2vr/core/text.hpp"

#include <cerrno>
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
  if (std::filesystem::is_directory(path, ignored)) refuse("a folder");
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
