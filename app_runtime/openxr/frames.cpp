// SPDX-License-Identifier: Apache-2.0
// Checks of layers.
#include "frames.hpp"

#include <dlfcn.h>
#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>

#include "api.hpp"
#include "calls.hpp"
#include "check.hpp"
#include "harness.hpp"
#include "pixels.hpp"
#include "session.hpp"

namespace sim2vr::openxr {
namespace {

constexpr XrCompositionLayerFlags kLayerFlags =
    XR_COMPOSITION_LAYER_CORRECT_CHROMATIC_ABERRATION_BIT |
    XR_COMPOSITION_LAYER_BLEND_TEXTURE_SOURCE_ALPHA_BIT |
    XR_COMPOSITION_LAYER_UNPREMULTIPLIED_ALPHA_BIT;

/// The session's swapchain of a sub-image; its rectangle lies inside.
void checkSubImage(const Session& session, const XrSwapchainSubImage& image,
                   const std::string& name) {
  const auto swapchain = get<Swapchain>(image.swapchain, "swapchain of a layer");
  requireOwn(session, swapchain->session.get(), name + ".swapchain");
  if (!swapchain->released) {
    throw Failure(XR_ERROR_LAYER_INVALID, name + ".swapchain has no image that was released");
  }
  if (image.imageArrayIndex >= swapchain->info.arraySize) {
    invalid(fmt::format("{}.imageArrayIndex is {}, expected below {}", name, image.imageArrayIndex,
                        swapchain->info.arraySize));
  }
  const XrOffset2Di& offset = image.imageRect.offset;
  const XrExtent2Di& extent = image.imageRect.extent;
  const bool inside = offset.x >= 0 && offset.y >= 0 && extent.width > 0 && extent.height > 0 &&
                      static_cast<std::int64_t>(offset.x) + extent.width <= swapchain->info.width &&
                      static_cast<std::int64_t>(offset.y) + extent.height <= swapchain->info.height;
  if (!inside) {
    throw Failure(XR_ERROR_SWAPCHAIN_RECT_INVALID,
                  fmt::format("{}.imageRect is {} {} {} {}, expected inside {} x {}", name,
                              offset.x, offset.y, extent.width, extent.height,
                              swapchain->info.width, swapchain->info.height));
  }
}

void checkDepth(const Session& session, const XrCompositionLayerProjectionView& view,
                const std::string& name) {
  if (!session.instance->enabled("XR_KHR_composition_layer_depth")) return;
  const auto* depth =
      chained<XrCompositionLayerDepthInfoKHR>(view.next, XR_TYPE_COMPOSITION_LAYER_DEPTH_INFO_KHR);
  if (depth == nullptr) return;
  checkSubImage(session, depth->subImage, name + " depth");
  const auto swapchain = get<Swapchain>(depth->subImage.swapchain, "swapchain of a layer");
  if (!session.graphics->isDepth(swapchain->info.format)) {
    invalid(name + " depth: the swapchain's format holds no depth");
  }
  const bool fits = depth->minDepth >= 0.0F && depth->maxDepth <= 1.0F &&
                    depth->minDepth < depth->maxDepth && depth->nearZ != depth->farZ &&
                    depth->nearZ >= 0.0F && depth->farZ >= 0.0F;
  if (!fits) {
    invalid(fmt::format("{} depth: minDepth {}, maxDepth {}, nearZ {}, farZ {}", name,
                        depth->minDepth, depth->maxDepth, depth->nearZ, depth->farZ));
  }
}

void checkProjection(const Session& session, const XrCompositionLayerProjection& layer,
                     const std::string& name) {
  if (layer.viewCount != kEyes) {
    invalid(fmt::format("{}.viewCount is {}, expected 2", name, layer.viewCount));
  }
  requirePointer(layer.views, "layer->views");
  requireTypes(layer.views, layer.viewCount, XR_TYPE_COMPOSITION_LAYER_PROJECTION_VIEW, "views");
  for (std::uint32_t i = 0; i < layer.viewCount; ++i) {
    const XrCompositionLayerProjectionView& view = layer.views[i];
    const std::string view_name = fmt::format("{}.views[{}]", name, i);
    requirePose(view.pose, view_name + ".pose");
    const XrFovf& fov = view.fov;
    if (!std::isfinite(fov.angleLeft + fov.angleRight + fov.angleUp + fov.angleDown)) {
      invalid(view_name + ".fov is not finite");
    }
    checkSubImage(session, view.subImage, view_name + ".subImage");
    checkDepth(session, view, view_name);
  }
}

void checkQuad(const Session& session, const XrCompositionLayerQuad& layer,
               const std::string& name) {
  requirePose(layer.pose, name + ".pose");
  if (!std::isfinite(layer.size.width + layer.size.height)) invalid(name + ".size is not finite");
  if (layer.eyeVisibility < XR_EYE_VISIBILITY_BOTH ||
      layer.eyeVisibility > XR_EYE_VISIBILITY_RIGHT) {
    invalid(fmt::format("{}.eyeVisibility is {}", name, static_cast<int>(layer.eyeVisibility)));
  }
  checkSubImage(session, layer.subImage, name + ".subImage");
}

constexpr std::uint8_t kFarthest = 255;

ImagePart partOf(const XrSwapchainSubImage& image) {
  const auto swapchain = get<Swapchain>(image.swapchain, "swapchain of a layer");
  return {swapchain->images.get(), *swapchain->released, image.imageArrayIndex, image.imageRect};
}

/// Some programs turn the picture over by a field of view whose upper angle is the smaller one.
void flipRows(std::span<std::uint8_t> rows, std::size_t row_bytes) {
  const std::size_t count = rows.size() / row_bytes;
  for (std::size_t i = 0; i < count / 2; ++i) {
    const auto upper = rows.subspan(i * row_bytes, row_bytes);
    const auto lower = rows.subspan((count - 1 - i) * row_bytes, row_bytes);
    std::swap_ranges(upper.begin(), upper.end(), lower.begin());
  }
}

/// One pixel over another, in linear light as OpenXR says. The alpha of `under` is its depth.
void blend(std::uint8_t* under, const std::uint8_t* over, XrCompositionLayerFlags flags) {
  if ((flags & XR_COMPOSITION_LAYER_BLEND_TEXTURE_SOURCE_ALPHA_BIT) == 0 || over[3] == 255) {
    std::copy_n(over, 3, under);
    return;
  }
  const bool straight = (flags & XR_COMPOSITION_LAYER_UNPREMULTIPLIED_ALPHA_BIT) != 0;
  const float alpha = static_cast<float>(over[3]) / 255.0F;
  const auto& linear = linearValues(true);
  for (int c = 0; c < 3; ++c) {
    const float source = straight ? linear[over[c]] * alpha : linear[over[c]];
    under[c] = linearToByte(source + linear[under[c]] * (1.0F - alpha));
  }
}

/// Distance along the view axis of a depth value, as XR_KHR_composition_layer_depth defines it.
double metres(const XrCompositionLayerDepthInfoKHR& info, float value) {
  const double unit =
      (value - info.minDepth) / (static_cast<double>(info.maxDepth) - info.minDepth);
  const double inverse = (1.0 - unit) / info.nearZ + unit / info.farZ;
  return inverse > 0.0 ? 1.0 / inverse : std::numeric_limits<double>::infinity();
}

/// The renderer's depth channel: of 255 steps, 255 = farthest_m and beyond.
std::uint8_t depthByte(double depth_m, double farthest_m) {
  const double share = depth_m / farthest_m;
  if (!(share < 1.0)) return kFarthest;
  return static_cast<std::uint8_t>(std::floor(std::max(0.0, share) * 255.0 + 0.5));
}

const XrCompositionLayerDepthInfoKHR* depthOf(const Instance& instance,
                                              const XrCompositionLayerProjectionView& view) {
  if (!instance.config.depth || !instance.enabled("XR_KHR_composition_layer_depth")) {
    return nullptr;
  }
  return chained<XrCompositionLayerDepthInfoKHR>(view.next,
                                                 XR_TYPE_COMPOSITION_LAYER_DEPTH_INFO_KHR);
}

/// Everything that will be read, so that it is fetched together.
std::vector<ImagePart> partsOf(const Instance& instance, const XrFrameEndInfo& info) {
  std::vector<ImagePart> parts;
  for (std::uint32_t i = 0; i < info.layerCount; ++i) {
    const XrCompositionLayerBaseHeader& layer = *info.layers[i];
    if (layer.type == XR_TYPE_COMPOSITION_LAYER_QUAD) {
      parts.push_back(partOf(reinterpret_cast<const XrCompositionLayerQuad&>(layer).subImage));
      continue;
    }
    const auto& projection = reinterpret_cast<const XrCompositionLayerProjection&>(layer);
    for (std::uint32_t eye = 0; eye < instance.config.eyes; ++eye) {
      const XrCompositionLayerProjectionView& view = projection.views[eye];
      parts.push_back(partOf(view.subImage));
      if (const auto* depth = depthOf(instance, view)) parts.push_back(partOf(depth->subImage));
    }
  }
  return parts;
}

struct Eye {
  std::uint32_t index;
  std::uint32_t width;
  std::uint32_t height;
  std::span<std::uint8_t> rgba;
};

bool drawDepth(Session& session, const XrCompositionLayerProjectionView& view, const Eye& eye) {
  const auto* info = depthOf(*session.instance, view);
  if (info == nullptr) return false;
  std::vector<float> depth(static_cast<std::size_t>(eye.width) * eye.height);
  session.graphics->readDepth(partOf(info->subImage), eye.width, eye.height, depth);
  const double farthest_m = session.instance->config.farthest_m;
  const bool flipped = view.fov.angleUp < view.fov.angleDown;
  for (std::uint32_t row = 0; row < eye.height; ++row) {
    const std::uint32_t from = flipped ? eye.height - 1 - row : row;
    for (std::uint32_t column = 0; column < eye.width; ++column) {
      const float value = depth[static_cast<std::size_t>(from) * eye.width + column];
      eye.rgba[(static_cast<std::size_t>(row) * eye.width + column) * 4 + 3] =
          depthByte(metres(*info, value), farthest_m);
    }
  }
  return true;
}

void drawProjection(Session& session, const XrCompositionLayerProjection& layer, const Eye& eye,
                    bool first) {
  const XrCompositionLayerProjectionView& view = layer.views[eye.index];
  std::vector<std::uint8_t> pixels(eye.rgba.size());
  session.graphics->readColor(partOf(view.subImage), eye.width, eye.height, pixels);
  if (view.fov.angleUp < view.fov.angleDown) {
    flipRows(pixels, static_cast<std::size_t>(eye.width) * 4);
  }
  // Nothing lies under the first layer.
  const XrCompositionLayerFlags flags = first ? 0 : layer.layerFlags;
  for (std::size_t i = 0; i < pixels.size(); i += 4) blend(&eye.rgba[i], &pixels[i], flags);
}

using Vector = Eigen::Vector3d;

/// A point given in the frame of `pose`.
Vector moved(const XrPosef& pose, const Vector& point) {
  const Eigen::Quaterniond q(pose.orientation.w, pose.orientation.x, pose.orientation.y,
                             pose.orientation.z);
  return q * point + Vector(pose.position.x, pose.position.y, pose.position.z);
}

/// A quad is seen from its front only.
void drawQuad(Session& session, const XrCompositionLayerQuad& layer, const Eye& eye, XrTime time) {
  const auto hidden = eye.index == 0 ? XR_EYE_VISIBILITY_RIGHT : XR_EYE_VISIBILITY_LEFT;
  const auto space = get<Space>(layer.space, "space of a layer");
  const auto stage_T_space = session.tracking.locate(*space, time);
  const double width_m = layer.size.width;
  const double height_m = layer.size.height;
  if (layer.eyeVisibility == hidden || !stage_T_space || !(width_m > 0.0) || !(height_m > 0.0)) {
    return;
  }
  const auto columns = static_cast<std::uint32_t>(layer.subImage.imageRect.extent.width);
  const auto rows = static_cast<std::uint32_t>(layer.subImage.imageRect.extent.height);
  std::vector<std::uint8_t> texture(static_cast<std::size_t>(columns) * rows * 4);
  session.graphics->readColor(partOf(layer.subImage), columns, rows, texture);
  const XrPosef stage_T_quad = xr::compose(stage_T_space->pose, layer.pose);
  const xr::Space view = xr::eyeSpace(eye.index, session.instance->config.ipd_m);
  const XrPosef quad_T_eye =
      xr::compose(xr::inverse(stage_T_quad), session.tracking.locate(view, time)->pose);
  const Vector origin = moved(quad_T_eye, Vector::Zero());
  if (!(origin.z() > 0.0)) return;
  const XrFovf fov = session.instance->config.fov();
  const double half_x = std::tan(static_cast<double>(fov.angleRight));
  const double half_y = std::tan(static_cast<double>(fov.angleUp));
  for (std::uint32_t row = 0; row < eye.height; ++row) {
    for (std::uint32_t column = 0; column < eye.width; ++column) {
      const Vector ray((2.0 * (column + 0.5) / eye.width - 1.0) * half_x,
                       (1.0 - 2.0 * (row + 0.5) / eye.height) * half_y, -1.0);
      const Vector direction = moved(quad_T_eye, ray) - origin;
      if (!(direction.z() < 0.0)) continue;
      const Vector hit = origin - direction * (origin.z() / direction.z());
      const double u = hit.x() / width_m + 0.5;
      const double v = 0.5 - hit.y() / height_m;
      if (!(u >= 0.0 && u < 1.0 && v >= 0.0 && v < 1.0)) continue;
      const std::size_t texel =
          (static_cast<std::size_t>(v * rows) * columns + static_cast<std::size_t>(u * columns)) *
          4;
      blend(&eye.rgba[(static_cast<std::size_t>(row) * eye.width + column) * 4], &texture[texel],
            layer.layerFlags);
    }
  }
}

/// How long a program whose harness is gone may go on with empty frames.
constexpr XrDuration kGrace_ns = kSecond_ns;

std::int64_t monotonic_ns() {
  struct timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * kSecond_ns + now.tv_nsec;
}

/// Sets the program's clocks, where the harness has preloaded virtual ones (preload/clock.c).
void advanceClock(XrTime time) {
  using Advance = void (*)(std::int64_t);
  static const auto advance =
      reinterpret_cast<Advance>(::dlsym(RTLD_DEFAULT, "sim2vr_clock_advance"));
  if (advance != nullptr) advance(time);
}

/// Someone who stands still, for programs without a harness.
xr::DeviceState standing() {
  xr::DeviceState state;
  state.head.position = {0.0F, 1.6F, 0.0F};
  for (const xr::Hand hand : xr::kHands) {
    xr::ControllerState& controller = state.hand(hand);
    controller.active = true;
    controller.grip.position = {hand == xr::Hand::left ? -0.2F : 0.2F, 1.2F, -0.4F};
    controller.aim = xr::compose(controller.grip, xr::kGripToAim);
  }
  return state;
}

/// Without the lock.
void sleep(Lock& lock, std::int64_t duration_ns) {
  lock.unlock();
  realSleep(duration_ns);
  lock.lock();
}

xr::Frame realTimeFrame(Session& session, Lock& lock) {
  const XrDuration period = session.instance->config.period_ns();
  // The display shows a picture one period after the program may begin with it.
  const xr::Frame* latest = session.tracking.latest();
  const XrTime next = latest == nullptr ? 0 : latest->time;
  const std::int64_t now = monotonic_ns();
  if (next > now) sleep(lock, std::min<std::int64_t>(next - now, period));
  const std::int64_t start = std::max<std::int64_t>(monotonic_ns(), next);
  return {start + period, standing()};
}

bool ended(const Session& session) {
  return session.lost || session.destroyed || session.instance->harness->lost();
}

/// Waits until the frame before was ended, by whatever thread.
void awaitEnd(Session& session, Lock& lock) {
  FrameLoop& loop = session.loop;
  if (loop.done_frames == loop.waited_frames) return;
  session.instance->harness->expect(
      "xrWaitFrame",
      "program waits for a frame before it ended the last: use gate: pipelined; xrEndFrame did not "
      "come");
  while (loop.done_frames != loop.waited_frames && !ended(session)) {
    world().changed.wait(lock);
  }
}

/// In pipelined lockstep a step is answered when the program wants the next, with the picture of
/// the frame before the last one: the last may still be drawn.
void answer(Session& session, const Picture& picture) {
  StepProgress& step = session.step;
  if (!step.open) return;
  step.open = false;
  Answer message;
  message.frames_shown = step.shown;
  message.layers = step.layers;
  message.should_render = session.state == XR_SESSION_STATE_FOCUSED;
  session.instance->harness->answer(std::move(message), picture);
}

/// Asks the harness for a step. False: the session stops.
bool takeStep(Session& session, Lock& lock) {
  const std::shared_ptr<Harness> harness = session.instance->harness;
  std::optional<Step> next;
  harness->relax();
  lock.unlock();
  try {
    next = harness->nextStep();
  } catch (...) {
    lock.lock();
    throw;
  }
  lock.lock();
  if (!next) {
    stop(session);
    return false;
  }
  StepProgress& step = session.step;
  step.frames.assign(std::make_move_iterator(next->frames.begin()),
                     std::make_move_iterator(next->frames.end()));
  step.image_wanted = next->image_wanted;
  step.open = true;
  // Pipelined, the last frame may still be drawn when the step is answered.
  step.shown =
      session.instance->config.pipelined ? static_cast<std::uint32_t>(step.frames.size()) : 0;
  step.layers = 0;
  return true;
}

std::optional<xr::Frame> lockstepFrame(Session& session, Lock& lock) {
  StepProgress& step = session.step;
  if (step.frames.empty()) {
    if (session.instance->config.pipelined) {
      answer(session, session.pictures[(session.loop.waited_frames + 1) % 2]);
    } else {
      awaitEnd(session, lock);
    }
    checkHarness(session);
    if (session.exiting || session.lost || session.destroyed) return std::nullopt;
    if (!takeStep(session, lock)) return std::nullopt;
  }
  xr::Frame frame = std::move(step.frames.front());
  step.frames.pop_front();
  return frame;
}

/// Empty frames at the display's pace while the program takes its leave.
std::optional<xr::Frame> stoppingFrame(Session& session, Lock& lock) {
  const XrDuration period = session.instance->config.period_ns();
  ++session.frames_after_stop;
  if (session.harness_gone && session.frames_after_stop * period > kGrace_ns) {
    lose(session);
    requireAlive(session);
  }
  if (session.frames_after_stop > 1) sleep(lock, period);
  return std::nullopt;
}

bool pictureWanted(const Session& session) {
  const Instance& instance = *session.instance;
  if (!instance.harness || !instance.config.images || !session.graphics) return false;
  // Pipelined: whether the next step wants this one is not known yet.
  if (instance.config.pipelined) return session.step.frames.size() <= 1;
  return session.step.image_wanted && session.step.frames.empty();
}

void requireRunning(const Session& session) {
  if (!session.running) throw Failure(XR_ERROR_SESSION_NOT_RUNNING, "the session does not run");
}

void expect(Session& session, const char* call, const char* cause) {
  if (Harness* harness = session.instance->harness.get(); harness != nullptr && !session.exiting) {
    harness->expect(call, cause);
  }
}

/// One thread waits at a time, and only after the frame before has begun.
void awaitTurn(Session& session, Lock& lock) {
  FrameLoop& loop = session.loop;
  while (loop.waiting || loop.waited) {
    world().changed.wait(lock);
    checkHarness(session);
    requireAlive(session);
    requireRunning(session);
    if (session.destroyed) throw Failure(XR_ERROR_HANDLE_INVALID, "the session was destroyed");
  }
}

/// Ends the turn however the wait ends.
class Turn {
 public:
  explicit Turn(FrameLoop& loop) : loop_(loop) { loop_.waiting = true; }
  ~Turn() {
    loop_.waiting = false;
    world().changed.notify_all();
  }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

 private:
  FrameLoop& loop_;
};

}  // namespace

void checkLayers(const Session& session, const XrFrameEndInfo& info) {
  if (info.layerCount > kMaximumLayers) {
    throw Failure(XR_ERROR_LAYER_LIMIT_EXCEEDED,
                  fmt::format("{} layers, expected up to {}", info.layerCount, kMaximumLayers));
  }
  for (std::uint32_t i = 0; i < info.layerCount; ++i) {
    const std::string name = fmt::format("layers[{}]", i);
    if (info.layers == nullptr || info.layers[i] == nullptr) {
      throw Failure(XR_ERROR_LAYER_INVALID, name + " is null");
    }
    const XrCompositionLayerBaseHeader& layer = *info.layers[i];
    if (layer.type != XR_TYPE_COMPOSITION_LAYER_PROJECTION &&
        layer.type != XR_TYPE_COMPOSITION_LAYER_QUAD) {
      throw Failure(XR_ERROR_LAYER_INVALID,
                    fmt::format("{}.type is {}, expected a projection or a quad layer", name,
                                static_cast<int>(layer.type)));
    }
    if ((layer.layerFlags & ~kLayerFlags) != 0) {
      invalid(fmt::format("{}.layerFlags is {:#x}, expected bits of {:#x}", name, layer.layerFlags,
                          kLayerFlags));
    }
    const auto space = get<Space>(layer.space, "space of a layer");
    requireOwn(session, space->session.get(), name + ".space");
    if (layer.type == XR_TYPE_COMPOSITION_LAYER_PROJECTION) {
      checkProjection(session, reinterpret_cast<const XrCompositionLayerProjection&>(layer), name);
    } else {
      checkQuad(session, reinterpret_cast<const XrCompositionLayerQuad&>(layer), name);
    }
  }
}

// Layers composed into the picture that the harness gets.

Picture composePicture(Session& session, const XrFrameEndInfo& info) {
  const Config& config = session.instance->config;
  Picture picture;
  picture.rgba.assign(config.eyes * config.eyeBytes(), 0);
  picture.has_image = true;
  session.graphics->prefetch(partsOf(*session.instance, info));
  const std::span<std::uint8_t> all(picture.rgba);
  for (std::uint32_t index = 0; index < config.eyes; ++index) {
    const Eye eye{index, config.width, config.height,
                  all.subspan(index * config.eyeBytes(), config.eyeBytes())};
    for (std::size_t i = 3; i < eye.rgba.size(); i += 4) eye.rgba[i] = kFarthest;
    bool has_depth = false;
    for (std::uint32_t i = 0; i < info.layerCount; ++i) {
      const XrCompositionLayerBaseHeader& layer = *info.layers[i];
      if (layer.type == XR_TYPE_COMPOSITION_LAYER_QUAD) {
        drawQuad(session, reinterpret_cast<const XrCompositionLayerQuad&>(layer), eye,
                 info.displayTime);
        continue;
      }
      const auto& projection = reinterpret_cast<const XrCompositionLayerProjection&>(layer);
      drawProjection(session, projection, eye, i == 0);
      has_depth = has_depth || drawDepth(session, projection.views[index], eye);
    }
    picture.has_depth = has_depth;
  }
  return picture;
}

std::optional<xr::Frame> nextFrame(Session& session, Lock& lock) {
  std::optional<xr::Frame> frame;
  if (!session.instance->harness) {
    frame = realTimeFrame(session, lock);
  } else {
    try {
      if (!session.exiting) frame = lockstepFrame(session, lock);
    } catch (const std::runtime_error& error) {
      const auto* failure = dynamic_cast<const Failure*>(&error);
      if (failure != nullptr) throw;
      report(std::string("sim2vr OpenXR: xrWaitFrame: ") + error.what());
      session.instance->harness->ended(error.what(), "xrWaitFrame");
      harnessGone(session);
    }
    requireAlive(session);
    if (!frame) return stoppingFrame(session, lock);
    advanceClock(frame->time);
    session.monotonic_offset_ns = frame->time - monotonic_ns();
  }
  session.tracking.track(*frame);
  return frame;
}

void runHeadless(Session& session) {
  if (session.instance->harness) return;
  session.tracking.track({monotonic_ns() + session.instance->config.period_ns(), standing()});
  show(session);
}

void frameDone(Session& session, const XrFrameEndInfo* info) {
  FrameLoop& loop = session.loop;
  Picture picture;
  // Pixels are read before the frame counts as done: they may throw.
  if (info != nullptr && info->layerCount > 0 && pictureWanted(session)) {
    picture = composePicture(session, *info);
  }
  ++loop.done_frames;
  world().changed.notify_all();
  const std::shared_ptr<Harness>& harness = session.instance->harness;
  if (!harness) return;
  if (info != nullptr) {
    if (!session.instance->config.pipelined) ++session.step.shown;
    session.step.layers = info->layerCount;
  }
  session.pictures[loop.done_frames % 2] = std::move(picture);
  const bool last = session.step.frames.empty() && loop.done_frames == loop.waited_frames;
  try {
    if (last && !session.instance->config.pipelined) {
      answer(session, session.pictures[loop.done_frames % 2]);
    }
  } catch (const std::runtime_error& error) {
    report(std::string("sim2vr OpenXR: xrEndFrame: ") + error.what());
    harnessGone(session);
    return;
  }
  if (last && !session.exiting) {
    harness->expect("xrWaitFrame", "xrWaitFrame did not follow xrEndFrame");
  }
}

// xrWaitFrame, xrBeginFrame, xrEndFrame.

XrResult XRAPI_CALL calls::xrWaitFrame(XrSession session, const XrFrameWaitInfo* frameWaitInfo,
                                       XrFrameState* frameState) {
  return guarded("xrWaitFrame", [&](Lock& lock) {
    const auto self = liveSession(session);
    optionalStructure(frameWaitInfo, XR_TYPE_FRAME_WAIT_INFO, "frameWaitInfo");
    auto& state = structure(frameState, XR_TYPE_FRAME_STATE, "frameState");
    requireRunning(*self);
    awaitTurn(*self, lock);
    const Turn turn(self->loop);
    const std::optional<xr::Frame> frame = nextFrame(*self, lock);
    if (self->destroyed) throw Failure(XR_ERROR_HANDLE_INVALID, "the session was destroyed");
    requireRunning(*self);
    self->loop.waited = true;
    ++self->loop.waited_frames;
    if (frame) show(*self);
    const XrDuration period = self->instance->config.period_ns();
    // Frames of a session that stops have later times, too.
    state.predictedDisplayTime =
        frame ? frame->time : self->now() + period * std::max(self->frames_after_stop, 1U);
    state.predictedDisplayPeriod = period;
    state.shouldRender = self->state == XR_SESSION_STATE_VISIBLE || self->focused();
    expect(*self, "xrBeginFrame", "xrBeginFrame did not follow xrWaitFrame");
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrBeginFrame(XrSession session, const XrFrameBeginInfo* frameBeginInfo) {
  return guarded("xrBeginFrame", [&](Lock&) {
    const auto self = liveSession(session);
    optionalStructure(frameBeginInfo, XR_TYPE_FRAME_BEGIN_INFO, "frameBeginInfo");
    requireRunning(*self);
    FrameLoop& loop = self->loop;
    if (!loop.waited) {
      throw Failure(XR_ERROR_CALL_ORDER_INVALID, "xrWaitFrame has to be called before");
    }
    const bool discards = loop.begun;
    loop.waited = false;
    if (discards) frameDone(*self, nullptr);
    loop.begun = true;
    world().changed.notify_all();
    expect(*self, "xrEndFrame", "xrEndFrame did not follow xrBeginFrame");
    return discards ? XR_FRAME_DISCARDED : XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrEndFrame(XrSession session, const XrFrameEndInfo* frameEndInfo) {
  return guarded("xrEndFrame", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(frameEndInfo, XR_TYPE_FRAME_END_INFO, "frameEndInfo");
    requireRunning(*self);
    if (!self->loop.begun) {
      throw Failure(XR_ERROR_CALL_ORDER_INVALID, "xrBeginFrame has to be called before");
    }
    requireTime(info.displayTime, "frameEndInfo->displayTime");
    if (info.environmentBlendMode != XR_ENVIRONMENT_BLEND_MODE_OPAQUE) {
      throw Failure(XR_ERROR_ENVIRONMENT_BLEND_MODE_UNSUPPORTED,
                    fmt::format("environmentBlendMode is {}, expected OPAQUE (1)",
                                static_cast<int>(info.environmentBlendMode)));
    }
    checkLayers(*self, info);
    frameDone(*self, &info);
    self->loop.begun = false;
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr
