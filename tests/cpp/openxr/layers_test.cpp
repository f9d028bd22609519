// SPDX-License-Identifier: Apache-2.0
// Swapchains, the checks of xrEndFrame, and the picture that the harness gets.
#include <unistd.h>

#include <cmath>
#include <limits>

#include "program.hpp"

namespace sim2vr::openxr::test {
namespace {

struct Layers : ::testing::Test {
  FakeHarness harness;
  Program program;
  XrSpace stage = XR_NULL_HANDLE;
  std::vector<std::uint8_t> image;
  int memory = -1;

  ~Layers() override { ::close(memory); }

  void start(const nlohmann::json& config = nlohmann::json::object()) {
    harness.sendConfig(config);
    ASSERT_EQ(program.create({kPixels, "XR_KHR_composition_layer_depth"}), XR_SUCCESS);
    harness.send(MessageKind::accepted);
    ASSERT_EQ(program.createSession(false), XR_SUCCESS);
    ASSERT_EQ(program.begin(), XR_SUCCESS);
    harness.receiveJson(MessageKind::hello);
    memory = harness.file();
    const auto session = harness.receiveJson(MessageKind::session);
    EXPECT_EQ(session["depth_layers"], true);
    EXPECT_EQ(session["image_bytes"], 64);
    stage = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
    harness.sendStep();
    ASSERT_EQ(program.frame(), XR_SUCCESS);
    if (config.value("gate", "strict") == "strict") harness.receiveAnswer();
  }
  XrSwapchainSubImage whole(XrSwapchain swapchain, std::int32_t width = 4,
                            std::int32_t height = 2) const {
    return {swapchain, {{0, 0}, {width, height}}, 0};
  }
  std::vector<XrCompositionLayerProjectionView> views(XrSwapchain left, XrSwapchain right) const {
    XrCompositionLayerProjectionView view{};
    view.type = XR_TYPE_COMPOSITION_LAYER_PROJECTION_VIEW;
    view.pose.orientation.w = 1.0F;
    view.fov = {-1.0F, 1.0F, 0.7F, -0.7F};
    std::vector<XrCompositionLayerProjectionView> both{view, view};
    both[0].subImage = whole(left);
    both[1].subImage = whole(right);
    return both;
  }
  XrCompositionLayerProjection projection(
      const std::vector<XrCompositionLayerProjectionView>& of) const {
    return {XR_TYPE_COMPOSITION_LAYER_PROJECTION,  nullptr,  0, stage,
            static_cast<std::uint32_t>(of.size()), of.data()};
  }
  template <class Layer>
  static const XrCompositionLayerBaseHeader* base(const Layer& layer) {
    return reinterpret_cast<const XrCompositionLayerBaseHeader*>(&layer);
  }
  /// A frame with these layers; the picture is in `image`.
  FakeHarness::Head show(const std::vector<const XrCompositionLayerBaseHeader*>& layers) {
    harness.sendStep();
    EXPECT_EQ(program.frame(nullptr, layers), XR_SUCCESS);
    FakeHarness::Head head;
    harness.receiveAnswer(&head);
    image.assign(64, 0);
    EXPECT_EQ(::pread(memory, image.data(), 64, 0), 64);
    return head;
  }
  /// The result of xrEndFrame with one layer, inside a frame that goes on.
  XrResult submit(const XrCompositionLayerBaseHeader* layer) {
    return program.end(harness.latest(), {layer});
  }
  void beginFrame() {
    harness.sendStep();
    XrFrameState state{};
    state.type = XR_TYPE_FRAME_STATE;
    ASSERT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state), XR_SUCCESS);
    ASSERT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr), XR_SUCCESS);
  }
};

TEST_F(Layers, EachEyeHasItsPictureAndDepth) {
  start();
  const XrSwapchain left = program.swapchain(kColorFormat, 4, 2);
  const XrSwapchain right = program.swapchain(kColorFormat, 4, 2);
  const XrSwapchain depth = program.swapchain(kDepthFormat, 4, 2);
  program.show(left, 0x00030201);
  program.show(right, 0x00060504);
  program.show(depth, 0, 0.5F);
  auto both = views(left, right);
  EXPECT_FALSE(show({base(projection(both))}).has_depth);
  EXPECT_EQ(image[0], 1);
  EXPECT_EQ(image[2], 3);
  EXPECT_EQ(image[3], 255);
  EXPECT_EQ(image[32], 4);
  // With near 1 m and far 5 m, half way in the buffer is 2 * 5 / (5 + 1) = 1.667 m; of 10 m that
  // is 42.5 of 255 steps.
  XrCompositionLayerDepthInfoKHR info{
      XR_TYPE_COMPOSITION_LAYER_DEPTH_INFO_KHR, nullptr, whole(depth), 0.0F, 1.0F, 1.0F, 5.0F};
  both[0].next = both[1].next = &info;
  const auto head = show({base(projection(both))});
  EXPECT_TRUE(head.has_image && head.has_depth);
  EXPECT_NEAR(image[3], 42.5, 0.51);
  // Reversed and without a far plane: near / 0.5.
  info.nearZ = std::numeric_limits<float>::infinity();
  info.farZ = 2.0F;
  show({base(projection(both))});
  EXPECT_EQ(image[3], 102);  // 4 m
}

TEST_F(Layers, AQuadLiesWhereItsPoseIs) {
  start();
  const XrSwapchain sky = program.swapchain(kColorFormat, 4, 2);
  const XrSwapchain sign = program.swapchain(kColorFormat, 4, 2);
  program.show(sky, 0xFF000010);
  program.show(sign, 0xFF0000EE);
  // Fills the left half of the view: the head of frame 1 looks from (1, 1.6, 0) along -z, the view
  // is 4 m wide and 2 m high 1 m ahead.
  XrCompositionLayerQuad quad{};
  quad.type = XR_TYPE_COMPOSITION_LAYER_QUAD;
  quad.space = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_VIEW);
  quad.subImage = whole(sign);
  quad.pose = {{0, 0, 0, 1}, {-1.5F, 0, -1}};
  quad.size = {3.0F, 4.0F};
  const auto both = views(sky, sky);
  const auto layer = projection(both);
  show({base(layer), base(quad)});
  EXPECT_EQ(image[0], 0xEE);
  EXPECT_EQ(image[4], 0xEE);
  EXPECT_EQ(image[8], 0x10);
  EXPECT_EQ(image[12], 0x10);
  quad.eyeVisibility = XR_EYE_VISIBILITY_RIGHT;
  show({base(layer), base(quad)});
  EXPECT_EQ(image[0], 0x10);
  EXPECT_EQ(image[32], 0xEE);
  // Half transparent.
  program.show(sign, 0x80000080);
  quad.eyeVisibility = XR_EYE_VISIBILITY_BOTH;
  quad.layerFlags = XR_COMPOSITION_LAYER_BLEND_TEXTURE_SOURCE_ALPHA_BIT;
  show({base(layer), base(quad)});
  // sRGB bytes 128 and 16 are 0.21586 and 0.00518 of the light: 0.21586 + 0.00518 * 127 / 255 =
  // 0.21844, whose byte is 255 * (1.055 * 0.21844^(1 / 2.4) - 0.055) = 128.7.
  EXPECT_EQ(image[0], 129);
  EXPECT_EQ(image[1], 0);
  // Colours that are not multiplied yet: 0.21586 * 128 / 255 + 0.00258 = 0.11093, 93.6.
  quad.layerFlags |= XR_COMPOSITION_LAYER_UNPREMULTIPLIED_ALPHA_BIT;
  show({base(layer), base(quad)});
  EXPECT_EQ(image[0], 94);
  // With an alpha of 255 or 0, one of the two is there as it was.
  program.show(sign, 0xFF000080);
  show({base(layer), base(quad)});
  EXPECT_EQ(image[0], 0x80);
  program.show(sign, 0x00000080);
  show({base(layer), base(quad)});
  EXPECT_EQ(image[0], 0x10);
}

TEST_F(Layers, NoImageWhereNoneIsWanted) {
  start();
  harness.sendStep(1, false);
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  FakeHarness::Head head;
  harness.receiveAnswer(&head);
  EXPECT_FALSE(head.has_image);
}

TEST_F(Layers, PipelinedShowsTheFrameBefore) {
  start({{"gate", "pipelined"}});
  const XrSwapchain swapchain = program.swapchain(kColorFormat, 4, 2);
  const auto both = views(swapchain, swapchain);
  const auto layer = projection(both);
  program.show(swapchain, 11);
  harness.sendStep();
  ASSERT_EQ(program.frame(nullptr, {base(layer)}), XR_SUCCESS);
  harness.receiveAnswer();
  program.show(swapchain, 22);
  const auto head = show({base(layer)});  // its answer is that to the step before
  EXPECT_FALSE(head.has_image);
  program.show(swapchain, 33);
  EXPECT_TRUE(show({base(layer)}).has_image);
  EXPECT_EQ(image[0], 11);
}

TEST_F(Layers, WrongLayersHaveTheirCodes) {
  start();
  const XrSwapchain swapchain = program.swapchain(kColorFormat, 4, 2);
  beginFrame();
  auto both = views(swapchain, swapchain);
  auto layer = projection(both);
  EXPECT_EQ(submit(base(layer)), XR_ERROR_LAYER_INVALID);  // nothing was released
  program.show(swapchain, 1);
  EXPECT_EQ(submit(nullptr), XR_ERROR_LAYER_INVALID);
  both[1].pose.position.x = NAN;
  EXPECT_EQ(submit(base(layer)), XR_ERROR_POSE_INVALID);
  both[1].pose.position.x = 0.0F;
  both[0].pose.orientation.w = 0.5F;
  EXPECT_EQ(submit(base(layer)), XR_ERROR_POSE_INVALID);
  both[0].pose.orientation.w = 1.0F;
  both[0].subImage.imageRect.extent.width = 5;
  EXPECT_EQ(submit(base(layer)), XR_ERROR_SWAPCHAIN_RECT_INVALID);
  both[0].subImage.imageRect = {{-1, 0}, {4, 2}};
  EXPECT_EQ(submit(base(layer)), XR_ERROR_SWAPCHAIN_RECT_INVALID);
  both[0].subImage.imageRect = {{0x7FFFFFFF, 0}, {4, 2}};
  EXPECT_EQ(submit(base(layer)), XR_ERROR_SWAPCHAIN_RECT_INVALID);
  both[0].subImage = whole(swapchain);
  both[0].subImage.imageArrayIndex = 1;
  EXPECT_EQ(submit(base(layer)), XR_ERROR_VALIDATION_FAILURE);
  both[0].subImage.imageArrayIndex = 0;
  both[0].type = XR_TYPE_VIEW;
  EXPECT_EQ(submit(base(layer)), XR_ERROR_VALIDATION_FAILURE);
  both[0].type = both[1].type;
  layer.viewCount = 1;
  EXPECT_EQ(submit(base(layer)), XR_ERROR_VALIDATION_FAILURE);
  layer.viewCount = 2;
  layer.space = XR_NULL_HANDLE;
  EXPECT_EQ(submit(base(layer)), XR_ERROR_HANDLE_INVALID);
  layer.space = stage;
  layer.type = XR_TYPE_COMPOSITION_LAYER_CUBE_KHR;
  EXPECT_EQ(submit(base(layer)), XR_ERROR_LAYER_INVALID);
  layer.type = XR_TYPE_COMPOSITION_LAYER_PROJECTION;
  for (const XrCompositionLayerFlags flags : {0x8ULL, 0x8000000000000001ULL}) {
    layer.layerFlags = flags;
    EXPECT_EQ(submit(base(layer)), XR_ERROR_VALIDATION_FAILURE);
  }
  layer.layerFlags = 7;
  EXPECT_EQ(program.end(0, {base(layer)}), XR_ERROR_TIME_INVALID);
  const std::vector<const XrCompositionLayerBaseHeader*> many(17, base(layer));
  EXPECT_EQ(program.end(harness.latest(), many), XR_ERROR_LAYER_LIMIT_EXCEEDED);
  // The frame is still there.
  EXPECT_EQ(submit(base(layer)), XR_SUCCESS);
  EXPECT_EQ(submit(base(layer)), XR_ERROR_CALL_ORDER_INVALID);
  EXPECT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr),
            XR_ERROR_CALL_ORDER_INVALID);
}

TEST_F(Layers, SwapchainsKeepTheirOrder) {
  start();
  const XrSwapchain swapchain = program.swapchain(kColorFormat, 4, 2);
  const auto acquire = XR_CALL(program.instance, xrAcquireSwapchainImage);
  const auto wait = XR_CALL(program.instance, xrWaitSwapchainImage);
  const auto release = XR_CALL(program.instance, xrReleaseSwapchainImage);
  const XrSwapchainImageWaitInfo info{XR_TYPE_SWAPCHAIN_IMAGE_WAIT_INFO, nullptr, 0};
  EXPECT_EQ(wait(swapchain, &info), XR_ERROR_CALL_ORDER_INVALID);
  EXPECT_EQ(release(swapchain, nullptr), XR_ERROR_CALL_ORDER_INVALID);
  for (std::uint32_t i = 0; i < 3; ++i) {
    std::uint32_t index = 9;
    EXPECT_EQ(acquire(swapchain, nullptr, &index), XR_SUCCESS);
    EXPECT_EQ(index, i);
  }
  std::uint32_t index = 9;
  EXPECT_EQ(acquire(swapchain, nullptr, &index), XR_ERROR_CALL_ORDER_INVALID);
  EXPECT_EQ(release(swapchain, nullptr), XR_ERROR_CALL_ORDER_INVALID);
  EXPECT_EQ(wait(swapchain, &info), XR_SUCCESS);
  EXPECT_EQ(wait(swapchain, &info), XR_ERROR_CALL_ORDER_INVALID);
  EXPECT_EQ(release(swapchain, nullptr), XR_SUCCESS);
  // A negative timeout is none; images are there at once.
  for (const XrDuration timeout : {XrDuration{-5}, XrDuration{XR_INFINITE_DURATION}}) {
    const XrSwapchainImageWaitInfo timed{XR_TYPE_SWAPCHAIN_IMAGE_WAIT_INFO, nullptr, timeout};
    EXPECT_EQ(wait(swapchain, &timed), XR_SUCCESS);
    EXPECT_EQ(release(swapchain, nullptr), XR_SUCCESS);
  }
}

TEST_F(Layers, UnusableSwapchainsAreRefused) {
  start();
  XrSwapchainCreateInfo info{};
  info.type = XR_TYPE_SWAPCHAIN_CREATE_INFO;
  info.format = kColorFormat;
  info.width = info.height = 4;
  info.sampleCount = info.faceCount = info.mipCount = info.arraySize = 1;
  XrSwapchain made = XR_NULL_HANDLE;
  const auto with = [&](auto change) {
    XrSwapchainCreateInfo changed = info;
    change(changed);
    return XR_CALL(program.instance, xrCreateSwapchain)(program.session, &changed, &made);
  };
  EXPECT_EQ(with([](auto& c) { c.format = 77; }), XR_ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED);
  EXPECT_EQ(with([](auto& c) { c.width = 0; }), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(with([](auto& c) { c.height = 100'000; }), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(with([](auto& c) { c.faceCount = 6; }), XR_ERROR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(with([](auto& c) { c.faceCount = 2; }), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(with([](auto& c) { c.sampleCount = 0; }), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(with([](auto& c) { c.sampleCount = 4; }), XR_SUCCESS);
  EXPECT_EQ(with([](auto& c) { c.arraySize = 0; }), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(with([](auto& c) { c.arraySize = 65; }), XR_ERROR_FEATURE_UNSUPPORTED);
  // 4 x 4, 2 x 2, 1 x 1.
  EXPECT_EQ(with([](auto& c) { c.mipCount = 3; }), XR_SUCCESS);
  EXPECT_EQ(with([](auto& c) { c.mipCount = 4; }), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(with([](auto& c) {
              c.width = c.height = 8192;
              c.arraySize = 64;
            }),
            XR_ERROR_OUT_OF_MEMORY);
  EXPECT_EQ(with([](auto& c) { c.createFlags = XR_SWAPCHAIN_CREATE_PROTECTED_CONTENT_BIT; }),
            XR_ERROR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(with([](auto& c) { c.type = XR_TYPE_VIEW; }), XR_ERROR_VALIDATION_FAILURE);
}

}  // namespace
}  // namespace sim2vr::openxr::test
