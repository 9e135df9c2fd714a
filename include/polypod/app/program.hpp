// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The program `polypod` as a function, for a program of one's own that knows further families of machines.
#pragma once

namespace polypod::app {

/// What `polypod` does with these arguments; the exit status: 0 done, 1 the answer is no, 2 bad input, 3 a bug, 130 and
/// 143 interrupted and terminated. Takes over the standard streams and the signals of the process; call it once.
int run(int argc, char** argv);

}  // namespace polypod::app
