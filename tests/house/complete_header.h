// SPDX-License-Identifier: GPL-3.0-or-later
// A header that includes what it uses; the check must accept it.
#ifndef SERVOCAL_TESTS_COMPLETE_HEADER_H
#define SERVOCAL_TESTS_COMPLETE_HEADER_H

#include <vector>

inline std::vector<int> numbers() { return {1, 2}; }

#endif
