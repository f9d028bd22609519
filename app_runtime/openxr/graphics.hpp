// SPDX-License-Identifier: Apache-2.0
// What a session asks of the program's graphics API: swapchain images on the program's own device,
// and the pixels of those that it submitted. One file per API implements it.
#pragma once

#include <openxr/openxr.h>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>

#include "api.hpp"
#include "pixels.hpp"

namespace sim2vr::openxr {

/// Thrown by implementations: GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID, "text").
using GraphicsError = Failure;

/// One swapchain's images on the program's own device.
class SwapchainImages {
 public:
  virtual ~SwapchainImages() = default;
  virtual std::uint32_t count() const = 0;
  /// Fills the program's array (XrSwapchainImageOpenGLKHR, ...VulkanKHR) of count() structures. The
  /// caller has checked their type fields.
  virtual void describe(XrSwapchainImageBaseHeader* images) const = 0;
  /// Called inside xrAcquireSwapchainImage, where the runtime may use the program's queue.
  virtual void acquired(std::uint32_t /*index*/) {}
};

/// A part of an image: `rect` in the image's own pixels, as the program gave it. The caller has
/// checked that it lies inside, and index and layer.
struct ImagePart {
  const SwapchainImages* images = nullptr;
  std::uint32_t index = 0;
  std::uint32_t layer = 0;
  XrRect2Di rect{};
};

/// The program's device. Calls come one at a time (the caller holds a mutex), from any thread of
/// the program.
class Graphics {
 public:
  virtual ~Graphics() = default;
  /// "egl", "opengl", "vulkan" or "vulkan2".
  virtual std::string_view name() const = 0;
  /// Type of the structures that SwapchainImages::describe fills.
  virtual XrStructureType imageType() const = 0;
  /// Best first: colour in sRGB, other colour, depth.
  virtual std::span<const std::int64_t> formats() const = 0;
  virtual bool isDepth(std::int64_t format) const = 0;
  /// Sizes, format and flags are checked by the caller. Throws GraphicsError
  /// (XR_ERROR_OUT_OF_MEMORY, XR_ERROR_FEATURE_UNSUPPORTED).
  virtual std::unique_ptr<SwapchainImages> createImages(const XrSwapchainCreateInfo& info) = 0;
  /// Called once in xrEndFrame with the parts that read() will be asked for, so
  /// that they are fetched together. Reading works without it.
  virtual void prefetch(std::span<const ImagePart> /*parts*/) {}
  /// The part's pixels as they are in the image; they stay until the next call.
  virtual PixelView read(const ImagePart& part) = 0;

  void readColor(const ImagePart& part, std::uint32_t width, std::uint32_t height,
                 std::span<std::uint8_t> rgba) {
    showColor(read(part), width, height, rgba);
  }
  void readDepth(const ImagePart& part, std::uint32_t width, std::uint32_t height,
                 std::span<float> depth) {
    showDepth(read(part), width, height, depth);
  }
};

/// A way to draw, found by the extension that the program enabled.
struct GraphicsMaker {
  std::string_view extension;
  /// Its XrExtensionProperties::extensionVersion.
  std::uint32_t version = 1;
  /// Of XrSessionCreateInfo::next.
  XrStructureType binding = XR_TYPE_UNKNOWN;
  /// The call that has to precede xrCreateSession; empty: none.
  std::string_view requirements;
  /// Throws GraphicsError where the program's device cannot be used.
  std::unique_ptr<Graphics> (*create)(const XrBaseInStructure& binding) = nullptr;
  /// Functions of the extension by name; null: it has no such function.
  PFN_xrVoidFunction (*function)(std::string_view name) = nullptr;
};

/// Every way that was built in, in the order in which enabled extensions are looked through.
std::span<const GraphicsMaker> graphicsMakers();

// For the functions of GraphicsMaker::function, which receive the program's raw arguments. They
// call this first and return its result unless it is XR_SUCCESS:
//   XR_ERROR_HANDLE_INVALID, XR_ERROR_FUNCTION_UNSUPPORTED (extension not enabled),
//   XR_ERROR_SYSTEM_INVALID. It also notes that `call` was made (GraphicsMaker::requirements).
XrResult graphicsCall(const char* call, XrInstance instance, XrSystemId system,
                      std::string_view extension);
/// Says on standard error why `call` fails, and returns `result`.
XrResult graphicsFailed(const char* call, XrResult result, std::string_view cause);

// One way to draw per file, gathered by graphics.cpp.

GraphicsMaker openglMaker();
GraphicsMaker eglMaker();
GraphicsMaker vulkanMaker();
GraphicsMaker vulkan2Maker();

}  // namespace sim2vr::openxr
