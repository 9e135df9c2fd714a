// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The questions of every family of machine::Families: what dispatch over AnyMachine needs to see.
#pragma once

#include "polypod/families/delta/parts.hpp"
#include "polypod/families/hexapod/parts.hpp"
#include "polypod/families/own/parts.hpp"
#include "polypod/families/parallel/parts.hpp"
#include "polypod/families/serial/parts.hpp"
#include "polypod/families/stages/parts.hpp"
