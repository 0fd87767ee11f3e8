// SPDX-License-Identifier: GPL-3.0-or-later
// Who may come in.
#pragma once

#include <string>

namespace servocal::live {

/// 128 random bits as hexadecimal digits.
std::string newToken();

/// True if both are the same; takes as long wherever they differ.
bool sameToken(const std::string& one, const std::string& other);

/// True if a request's Host header names this server: an IP address, "localhost" or `own_name`, with or
/// without a port. A page of a foreign site that had its own name resolved to this machine carries that name.
bool isOwnHost(const std::string& host_header, const std::string& own_name);

}  // namespace servocal::live
