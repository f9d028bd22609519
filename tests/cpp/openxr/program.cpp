// SPDX-License-Identifier: Apache-2.0
#include "program.hpp"

#include <cstring>

#include "calls.hpp"
#include "sim2vr/wire/numbers.hpp"

namespace sim2vr::openxr::test {

PFN_xrVoidFunction function(XrInstance instance, const char* name) {
  PFN_xrVoidFunction found = nullptr;
  calls::xrGetInstanceProcAddr(instance, name, &found);
  EXPECT_NE(found, nullptr) << name;
  return found;
}

FakeHarness::FakeHarness() {
  int ends[2];
  EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
  socket_ = ends[0];
  program_ = ends[1];
  channel_ = std::make_unique<Channel>(socket_);
  ::setenv("SIM2VR_OPENXR_SOCKET", std::to_string(program_).c_str(), 1);
}

FakeHarness::~FakeHarness() {
  ::unsetenv("SIM2VR_OPENXR_SOCKET");
  close();
  ::close(program_);
}

void FakeHarness::close() {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

void FakeHarness::send(MessageKind kind, const std::string& body) { channel_->send(kind, body); }

void FakeHarness::sendConfig(const nlohmann::json& changes) {
  nlohmann::json config{{"width", 4}, {"height", 2}, {"timeout_s", 5.0}, {"depth", true}};
  config.update(changes);
  send(MessageKind::config, config.dump());
}

void FakeHarness::sendStep(int frames, bool image_wanted, double trigger) {
  std::string body;
  wire::append(body, static_cast<std::uint32_t>(frames));
  for (int i = 0; i < frames; ++i) {
    time_ += 10'000'000;
    wire::append(body, time_);
    const double x = frame_++;
    for (const double value : {x, 1.6, 0.0, 0.0, 0.0, 0.0, 1.0}) wire::append(body, value);
    body += std::string("\0\1", 2);  // the right hand only
    for (int n = 0; n < 7; ++n) wire::append(body, 0.0);
    for (const double value : {0.2, 1.0, 0.5 + 0.1 * x, 0.0, 0.0, 0.0, 1.0}) {
      wire::append(body, value);
    }
    for (int n = 0; n < 13; ++n) wire::append(body, 0.0);
    for (int n = 0; n < 13; ++n) wire::append(body, n == 0 ? trigger : 0.0);
  }
  body += image_wanted ? '\1' : '\0';
  send(MessageKind::step, body);
}

int FakeHarness::file() const {
  char byte = 0;
  iovec part{&byte, 1};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))];
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof control;
  EXPECT_EQ(::recvmsg(socket_, &message, MSG_PEEK | MSG_CMSG_CLOEXEC), 1);
  const cmsghdr* rights = CMSG_FIRSTHDR(&message);
  if (rights == nullptr || rights->cmsg_type != SCM_RIGHTS) return -1;
  int file = -1;
  std::memcpy(&file, CMSG_DATA(rights), sizeof file);
  return file;
}

nlohmann::json FakeHarness::receiveJson(MessageKind kind) {
  const Message message = receive();
  EXPECT_EQ(message.kind, kind) << message.body;
  return nlohmann::json::parse(message.body);
}

nlohmann::json FakeHarness::receiveAnswer(Head* head) {
  const Message message = receive();
  EXPECT_EQ(message.kind, MessageKind::answer) << message.body;
  wire::Reader reader(message.body);
  Head got;
  got.frames = reader.take<std::uint32_t>();
  got.has_image = reader.take<std::uint8_t>() != 0;
  got.has_depth = reader.take<std::uint8_t>() != 0;
  const auto length = reader.take<std::uint32_t>();
  EXPECT_EQ(message.body.size(), 10 + length);
  if (head != nullptr) *head = got;
  return nlohmann::json::parse(message.body.substr(10));
}

Program::~Program() {
  if (instance != XR_NULL_HANDLE) XR_CALL(instance, xrDestroyInstance)(instance);
}

XrResult Program::create(const std::vector<const char*>& extensions, XrVersion version) {
  XrInstanceCreateInfo info{};
  info.type = XR_TYPE_INSTANCE_CREATE_INFO;
  std::strcpy(info.applicationInfo.applicationName, "program");
  info.applicationInfo.apiVersion = version;
  info.enabledExtensionCount = static_cast<std::uint32_t>(extensions.size());
  info.enabledExtensionNames = extensions.data();
  const XrResult result = XR_CALL(XR_NULL_HANDLE, xrCreateInstance)(&info, &instance);
  if (result != XR_SUCCESS) return result;
  const XrSystemGetInfo get{XR_TYPE_SYSTEM_GET_INFO, nullptr, XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY};
  return XR_CALL(instance, xrGetSystem)(instance, &get, &system);
}

XrResult Program::createSession(bool headless) {
  const XrBaseInStructure binding{kPixelsBinding, nullptr};
  const XrSessionCreateInfo info{XR_TYPE_SESSION_CREATE_INFO, headless ? nullptr : &binding, 0,
                                 system};
  return XR_CALL(instance, xrCreateSession)(instance, &info, &session);
}

XrResult Program::begin() {
  const XrSessionBeginInfo info{XR_TYPE_SESSION_BEGIN_INFO, nullptr,
                                XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO};
  return XR_CALL(instance, xrBeginSession)(session, &info);
}

XrResult Program::end(XrTime time, const std::vector<const XrCompositionLayerBaseHeader*>& layers) {
  const XrFrameEndInfo info{XR_TYPE_FRAME_END_INFO,
                            nullptr,
                            time,
                            XR_ENVIRONMENT_BLEND_MODE_OPAQUE,
                            static_cast<std::uint32_t>(layers.size()),
                            layers.data()};
  return XR_CALL(instance, xrEndFrame)(session, &info);
}

XrResult Program::frame(XrFrameState* state,
                        const std::vector<const XrCompositionLayerBaseHeader*>& layers) {
  XrFrameState own{};
  if (state == nullptr) state = &own;
  state->type = XR_TYPE_FRAME_STATE;
  XrResult result = XR_CALL(instance, xrWaitFrame)(session, nullptr, state);
  if (XR_FAILED(result)) return result;
  result = XR_CALL(instance, xrBeginFrame)(session, nullptr);
  if (XR_FAILED(result)) return result;
  return end(state->predictedDisplayTime, layers);
}

XrPath Program::path(const char* text) const {
  XrPath path = XR_NULL_PATH;
  EXPECT_EQ(XR_CALL(instance, xrStringToPath)(instance, text, &path), XR_SUCCESS) << text;
  return path;
}

XrSpace Program::referenceSpace(XrReferenceSpaceType type) const {
  const XrReferenceSpaceCreateInfo info{
      XR_TYPE_REFERENCE_SPACE_CREATE_INFO, nullptr, type, {{0, 0, 0, 1}, {0, 0, 0}}};
  XrSpace space = XR_NULL_HANDLE;
  EXPECT_EQ(XR_CALL(instance, xrCreateReferenceSpace)(session, &info, &space), XR_SUCCESS);
  return space;
}

XrSwapchain Program::swapchain(std::int64_t format, std::uint32_t width, std::uint32_t height,
                               std::uint32_t layers) const {
  XrSwapchainCreateInfo info{};
  info.type = XR_TYPE_SWAPCHAIN_CREATE_INFO;
  info.format = format;
  info.width = width;
  info.height = height;
  info.sampleCount = info.faceCount = info.mipCount = 1;
  info.arraySize = layers;
  XrSwapchain swapchain = XR_NULL_HANDLE;
  EXPECT_EQ(XR_CALL(instance, xrCreateSwapchain)(session, &info, &swapchain), XR_SUCCESS);
  return swapchain;
}

void Program::show(XrSwapchain swapchain, std::uint32_t rgba, float depth) const {
  std::uint32_t index = 9;
  const XrSwapchainImageWaitInfo wait{XR_TYPE_SWAPCHAIN_IMAGE_WAIT_INFO, nullptr,
                                      XR_INFINITE_DURATION};
  EXPECT_EQ(XR_CALL(instance, xrAcquireSwapchainImage)(swapchain, nullptr, &index), XR_SUCCESS);
  EXPECT_EQ(XR_CALL(instance, xrWaitSwapchainImage)(swapchain, &wait), XR_SUCCESS);
  std::uint32_t count = 0;
  std::vector<PixelsImage> images(8, PixelsImage{kPixelsImage, nullptr, nullptr});
  EXPECT_EQ(XR_CALL(instance, xrEnumerateSwapchainImages)(
                swapchain, 8, &count, reinterpret_cast<XrSwapchainImageBaseHeader*>(images.data())),
            XR_SUCCESS);
  // Of one pixel: what every reader of the fake graphics returns everywhere.
  std::memcpy(images[index].rgba, &rgba, 4);
  std::memcpy(images[index].rgba + 4, &depth, 4);
  EXPECT_EQ(XR_CALL(instance, xrReleaseSwapchainImage)(swapchain, nullptr), XR_SUCCESS);
}

std::vector<XrSessionState> Program::states() const {
  std::vector<XrSessionState> states;
  for (;;) {
    XrEventDataBuffer event{};
    event.type = XR_TYPE_EVENT_DATA_BUFFER;
    if (XR_CALL(instance, xrPollEvent)(instance, &event) != XR_SUCCESS) return states;
    if (event.type != XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED) continue;
    XrEventDataSessionStateChanged change{};
    std::memcpy(&change, &event, sizeof change);
    states.push_back(change.state);
  }
}

}  // namespace sim2vr::openxr::test
