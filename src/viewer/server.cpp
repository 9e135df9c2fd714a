// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/viewer/server.hpp"

#include <fmt/format.h>
#include <httplib.h>

#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "polypod/report/html.hpp"

namespace polypod::viewer {

Status serve(const Site& site, const ServeOptions& options) {
  constexpr const char* kHere = "127.0.0.1";
  httplib::Server server;
  constexpr std::size_t kMostBytes = 1'000'000;
  constexpr time_t kPatience = 5;  // s
  server.set_payload_max_length(kMostBytes);
  // Head and body of an answer are two packets: the second would wait 40 ms for the browser's receipt of the first.
  server.set_tcp_nodelay(true);
  server.set_read_timeout(kPatience);
  server.set_write_timeout(kPatience);
  server.set_keep_alive_max_count(1000);
  constexpr time_t kKeepAlive = 2;  // s
  server.set_keep_alive_timeout(kKeepAlive);
  constexpr std::size_t kThreads = 64;                                       // a connection that is slow holds one
  server.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };  // the server owns it
  // The library's own default lets two servers share one port.
  server.set_socket_options([](socket_t socket) {
    int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  int port = options.port;
  std::atomic<int> pages{0};
  const std::string scripts = report::script_sources(true, true);
  const auto handle = [&](const httplib::Request& request, httplib::Response& response) {
    // A header that names two hosts or two origins names none.
    const bool twice = request.get_header_value_count("Host") > 1 || request.get_header_value_count("Origin") > 1;
    const Response answer = twice ? Response{403, "text/plain; charset=utf-8", "Host and Origin stand once.\n"}
                                  : site.answer({request.method, request.path, request.get_header_value("Host"),
                                                 request.get_header_value("Origin"), request.body},
                                                port);
    response.status = answer.status;
    response.set_header("Cache-Control", "no-store");
    response.set_header("X-Content-Type-Options", "nosniff");
    response.set_header("X-Frame-Options", "DENY");
    // Besides the policy in each page: no script but those of this version, whatever a served file says.
    response.set_header("Content-Security-Policy",
                        "default-src 'none'; script-src " + scripts +
                            "; style-src 'unsafe-inline'; img-src data: blob:; connect-src 'self'; base-uri 'none'; "
                            "form-action 'none'; frame-ancestors 'none'");
    response.set_header("Referrer-Policy", "no-referrer");
    response.set_header("Cross-Origin-Resource-Policy", "same-origin");
    response.set_content(answer.body, answer.type.c_str());
  };
  server.Get(".*", handle);
  server.Post(".*", handle);
  // Called when the answer has been sent.
  server.set_logger([&](const httplib::Request& request, const httplib::Response& response) {
    if (request.method == "GET" && response.status == 200) ++pages;
  });
  if (port == 0) {
    port = server.bind_to_any_port(kHere);
    if (port <= 0) return fail("VW110", "no port of 127.0.0.1 can be listened on");
  } else if (!server.bind_to_port(kHere, port)) {
    return fail("VW110", fmt::format("port {} of 127.0.0.1 cannot be listened on", port), {},
                "another program may have it: leave --port out, and a free one is taken");
  }
  std::thread listener([&] { server.listen_after_bind(); });
  if (options.ready) options.ready(fmt::format("http://{}:{}/", kHere, port));
  while (!(options.stop && options.stop()) && !(options.once && pages > 0)) {
    std::this_thread::sleep_for(std::chrono::milliseconds(options.once ? 20 : 100));
  }
  site.stop();
  server.stop();
  listener.join();
  return {};
}

}  // namespace polypod::viewer
