// SPDX-License-Identifier: Apache-2.0
// Texts from outside: files that are read whole, and words that are shown.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace sim2vr {

/// All bytes of a file. Throws InvalidArgument naming `field`, the file, what is wrong with it and
/// `expected` for anything but a regular file, one that cannot be read, and one above 256 MiB.
std::string readTextFile(std::string_view field, const std::filesystem::path& path,
                         std::string_view expected);

/// The path that a file: URI stands for (RFC 8089, %XX for a byte); any other text is the path
/// itself. JSON cannot hold a path that is not UTF-8, a URI can. Throws InvalidArgument naming
/// `field` for a URI that names another machine or has a damaged %XX.
std::string pathFromUri(std::string_view field, std::string_view text);

/// The same text, with U+FFFD for every byte that is not UTF-8: for places that take nothing else,
/// such as JSON, Python strings and terminals.
std::string validUtf8(std::string_view text);

/// What a stranger wrote, for a line of a log or an error: `limit` characters at most, and control
/// characters, which could begin lines or colour the terminal, as \n or \u001b.
std::string printable(std::string_view text, std::size_t limit = 200);

}  // namespace sim2vr
