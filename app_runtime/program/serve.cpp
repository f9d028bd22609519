// SPDX-License-Identifier: Apache-2.0
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <system_error>

#include "outputs.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/games/registry.hpp"
#include "sim2vr/program/program.hpp"
#include "sim2vr/server/server.hpp"

namespace sim2vr::program {
namespace {

constexpr int kReferencePort = 5555;
constexpr double kTimeout_s = 60.0;
/// On the reference's default port a developer may be debugging.
constexpr double kDebugTimeout_s = 600.0;

/// For the signal handler, which can have no other context.
server::StopRequest* signalled = nullptr;

/// SIGINT and SIGTERM ask the server to end; a second one ends the process.
class Signals {
 public:
  explicit Signals(server::StopRequest& stop) {
    signalled = &stop;
    struct sigaction action{};
    action.sa_handler = [](int) { signalled->raise(); };
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    ::sigaction(SIGINT, &action, nullptr);
    ::sigaction(SIGTERM, &action, nullptr);
    ::signal(SIGPIPE, SIG_IGN);
  }
  ~Signals() {
    ::signal(SIGINT, SIG_DFL);
    ::signal(SIGTERM, SIG_DFL);
  }
};

/// Takes the descriptors that the hard limit allows, up to a number that is enough: where none is
/// left for a connection, new ones must be closed, and over a Unix socket ZeroMQ 4.3.4 ends the
/// process (ipc_listener.cpp does not expect EMFILE).
void raiseDescriptorLimit() {
  constexpr rlim_t kEnough = 65536;
  struct rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = std::max(limit.rlim_cur, std::min(limit.rlim_max, kEnough));
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

void requireCondition(const Arguments& arguments, const std::string& options) {
  if (!arguments.simulated) return;
  Options given = Options::fromJson(options);
  const auto game = games::createGame(arguments.game);
  game->configure(given);
  if (!given.wasRead("condition") || given.has("condition")) return;
  throw InvalidArgument("-condition", "none next to -simulated",
                        "the condition to play, such as -condition medium");
}

server::ServerSettings serverSettings(const Arguments& arguments) {
  server::ServerSettings settings;
  settings.address = arguments.bind;
  settings.port = arguments.port;
  const double usual_s = arguments.port == kReferencePort ? kDebugTimeout_s : kTimeout_s;
  settings.timeout = std::chrono::milliseconds(
      static_cast<std::int64_t>(std::ceil(1000.0 * arguments.timeout_s.value_or(usual_s))));
  settings.keep = arguments.keep;
  server::HostSettings& host = settings.host;
  host.app.game = arguments.game;
  host.app.options_json = gameOptions(arguments);
  host.app.headset_size = {arguments.width, arguments.height};
  host.app.log_dir = arguments.log_dir;
  host.renderer = arguments.renderer;
  host.recorder = recorderSettings(arguments, 20);
  host.fixed_seed = arguments.fixed_seed;
  host.frame_time = server::protocol1::frameTimeFromName("--frame-time", arguments.frame_time);
  host.clock = server::protocol1::clockOriginFromName("--clock", arguments.clock);
  host.realtime = arguments.realtime;
  host.time_scale = arguments.time_scale;
  host.threads = arguments.threads;
  return settings;
}

/// What a client would be refused for is said before it comes.
void validate(const Arguments& arguments, const server::ServerSettings& settings) {
  requireCondition(arguments, settings.host.app.options_json);
  settings.host.make_app(settings.host.app, render::Renderer::create(render::RendererKind::null),
                         {});
  requireWritable(arguments);
}

int exitCode(server::Ending ending) {
  const bool abandoned =
      ending == server::Ending::timed_out || ending == server::Ending::client_vanished;
  return abandoned ? kAbandoned : kSuccess;
}

}  // namespace

int serve(const Arguments& arguments) {
  const server::ServerSettings settings = serverSettings(arguments);
  validate(arguments, settings);
  raiseDescriptorLimit();
  server::StopRequest stop;
  const Signals signals(stop);
  server::Server server(settings);
  if (!settings.isLocal()) {
    logger().warn("listening on {}: every client that reaches it can use the app",
                  server.endpoint());
  }
  // Launchers wait for this line.
  std::cout << "sim2vr-app: listening on " << server.endpoint() << std::endl;
  return exitCode(server.run(stop));
}

}  // namespace sim2vr::program
