// A session of protocol 1: one app, the reference's order of messages and clocks.
#pragma once

#include <optional>

#include "pacer.hpp"
#include "sim2vr/server/protocol1.hpp"
#include "sim2vr/server/session.hpp"

namespace sim2vr::server {

class Session1 final : public Session {
 public:
  /// Throws as decodeHandshake and runtime::App do.
  Session1(AppHost& host, std::string_view handshake);

  /// Answer to the handshake.
  Reply greeting() const;
  Reply answer(Frames body) override;
  bool over() const override { return over_; }

 private:
  Reply answerState(const protocol1::State& state);
  runtime::StepResult play(const protocol1::State& state);
  runtime::StepResult reset(const protocol1::State& state);
  runtime::StepResult step(const protocol1::State& state);
  void checkClock(const protocol1::State& state) const;
  std::int64_t gameTimeNs(double user_time_s) const;
  void addExtensions(const protocol1::State& state, protocol1::Observation& observation);
  /// How the session holds the head in the round that begins; none: as the user does.
  std::optional<double> headPitch_deg(const runtime::RoundStart& start);

  AppHost& host_;
  protocol1::Handshake handshake_;
  protocol1::FrameTime frame_time_;
  protocol1::ClockOrigin clock_;
  protocol1::HeadRotation head_rotation_;
  std::unique_ptr<HostedApp> app_;
  Pacer pacer_;
  /// headPitch_deg of the round.
  std::optional<double> head_pitch_deg_;
  /// The user's clock at the start of the round, where the game clock restarts with each round.
  double origin_s_ = 0.0;
  /// The user's clock in its latest State; none before the first.
  std::optional<double> latest_s_;
  bool ended_by_user_ = false;
  bool over_ = false;
};

}  // namespace sim2vr::server
