// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What happens on Ctrl-C, and on the signals of `kill` and of a terminal that closes.
#pragma once

#include <stdexcept>

namespace polypod::app {

/// Call first in `main`, before there are other threads. From now on SIGINT, SIGTERM and SIGHUP are taken by a thread
/// of their own: `interrupted` is true at once, and long work that asks for it ends by itself. What has not ended
/// 100 ms later, or at a second signal, is ended where it stands: temporary files are removed and the process exits.
/// So the program ends within 0.2 s whatever it does, and as outputs appear by rename, none is half written. After a
/// signal was taken no output begins to appear. Throws NoThreads.
void catch_interrupts();

/// The system starts no thread for this process.
struct NoThreads : std::runtime_error {
  NoThreads() : std::runtime_error("no thread can be started") {}
};
bool interrupted();
/// Waits, up to a second, for a signal that has come but is not yet taken.
void wait_for_interrupt();

/// 130 after SIGINT, 143 after SIGTERM, 129 after SIGHUP, with a line on stderr; 0 if there was none.
int interrupted_status();

}  // namespace polypod::app
