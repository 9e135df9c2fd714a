// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the families say of how their numbers count: conventions_of(m) of each that has something to say.
#pragma once

#include "serial/conventions.hpp"
#include "stages/conventions.hpp"
