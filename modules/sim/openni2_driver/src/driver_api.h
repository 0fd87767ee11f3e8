// SPDX-License-Identifier: GPL-3.0-or-later
// OpenNI2's driver interface; its macros expect a library of the vendor's that is not installed.
#pragma once

#define XN_NEW(Type, ...) new Type(__VA_ARGS__)
#define XN_DELETE(pointer) delete (pointer)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wignored-qualifiers"
#include <Driver/OniDriverAPI.h>
#pragma GCC diagnostic pop
