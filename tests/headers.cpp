// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Nothing: a target whose headers are precompiled needs a source.
