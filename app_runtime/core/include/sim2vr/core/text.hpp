// Texts that somebody else wrote: files that are read whole, and words that are shown.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace sim2vr {

/// All bytes of a file. Throws InvalidArgument naming `field`, the file, what is wrong with it and
/// `expected` for a folder, one that cannot be read, and one above 256 MiB.
std::string readTextFile(std::string_view field, const std::filesystem::path& path,
                         std::string_view expected);

/// What a stranger wrote, for a line of a log or an error: `limit` characters at most, and control
/// characters, which could begin lines or colour the terminal, as \n or \u001b.
std::string printable(std::string_view text, std::size_t limit = 200);

}  // namespace sim2vr
