// A session of protocol 2: several apps, batched messages.
#pragma once

#include <memory>
#include <vector>

#include "pacer.hpp"
#include "sim2vr/runtime/thread_pool.hpp"
#include "sim2vr/server/protocol2.hpp"
#include "sim2vr/server/session.hpp"
#include "sim2vr/wire/shared_images.hpp"

namespace sim2vr::server {

class Session2 final : public Session {
 public:
  explicit Session2(AppHost& host);

  Reply answer(Frames body) override;
  bool over() const override { return over_; }
  /// False until a hello was answered.
  bool open() const { return !apps_.empty(); }

 private:
  using Header = protocol2::Header;

  Reply answerRequest(const Header& header, const protocol2::Request& request);
  Reply respond(const Header& header, const protocol2::Hello& hello);
  Reply respond(const Header& header, const protocol2::Reset& reset);
  Reply respond(const Header& header, const protocol2::Step& step);
  Reply respond(const Header& header, const PictureRequest& picture);
  Reply respond(const Header& header, const protocol2::Save& save);
  Reply respond(const Header& header, const protocol2::Load& load);
  Reply respond(const Header& header, const protocol2::Hash& hash);
  Reply respond(const Header& header, const protocol2::Quit& quit);
  Reply respond(const Header& header, const protocol2::HeadRequest& request);
  Reply respond(const Header& header, const protocol2::SceneRequest& request);
  runtime::AppSettings appSettings(const protocol2::Hello& hello) const;
  /// The answer to hello: what the session is.
  std::string about(const runtime::AppSettings& settings) const;
  /// Plays the records, those of different workers at the same time. A record that fails leaves its
  /// app as it was.
  template <class Record>
  Reply playAll(const Header& header, const std::vector<Record>& records);
  void checkApps(const std::vector<std::uint32_t>& indices) const;
  void addImages(const std::vector<protocol2::Result>& results, Reply& reply);
  HostedApp& app(std::uint32_t index);

  runtime::StepResult play(const protocol2::ResetRecord& record);
  runtime::StepResult play(const protocol2::StepRecord& record);
  void pace(const protocol2::ResetRecord& record);
  void pace(const protocol2::StepRecord& record);

  AppHost& host_;
  std::vector<std::unique_ptr<HostedApp>> apps_;
  std::unique_ptr<wire::SharedImages> shared_;
  runtime::ThreadPool workers_;
  protocol2::Names names_;
  /// What comes back is what the client can take.
  bool sends_haptics_ = true;
  bool sends_sounds_ = true;
  Pacer pacer_;
  bool over_ = false;
};

}  // namespace sim2vr::server
