// SPDX-License-Identifier: GPL-3.0-or-later
// As complete_header.h, but for its include; the check must refuse it.
#ifndef SERVOCAL_TESTS_FORGETFUL_HEADER_H
#define SERVOCAL_TESTS_FORGETFUL_HEADER_H

inline std::vector<int> numbers() { return {1, 2}; }

#endif
