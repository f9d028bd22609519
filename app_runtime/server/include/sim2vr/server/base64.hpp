// SPDX-License-Identifier: Apache-2.0
// Bytes as text (RFC 4648, with padding), for saved states in protocol 1.
#pragma once

#include <string>
#include <string_view>

namespace sim2vr::server {

std::string encodeBase64(std::string_view bytes);

/// Inverse of encodeBase64. Throws MalformedMessage for anything that encodeBase64 would not write.
std::string decodeBase64(std::string_view text);

}  // namespace sim2vr::server
