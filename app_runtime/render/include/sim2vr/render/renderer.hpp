// SPDX-License-Identifier: Apache-2.0
// Pictures of a scene. A GPU is not needed: Mesa draws on the CPU.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "sim2vr/render/components.hpp"
#include "sim2vr/render/image_size.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::render {

enum class RendererKind : std::uint8_t {
  /// egl, and osmesa where that fails.
  automatic,
  /// EGL without a window: the surfaceless platform (Mesa) or a device (NVIDIA).
  egl,
  /// Mesa's off-screen library, for machines without EGL.
  osmesa,
  /// No pictures: black and far away everywhere. For policies that do not look.
  null,
};

/// "automatic", "egl", "osmesa", "null".
std::string_view rendererKindName(RendererKind kind);
/// Inverse of rendererKindName; throws InvalidArgument("renderer", ...) for another word.
RendererKind rendererKindFromName(std::string_view name);

/// What one eye sees instead of its camera: from a place of its own, through a frustum that need
/// not be symmetric.
struct EyeView {
  /// Eye coordinates to camera coordinates (x right, y up, z forward, metres).
  Pose camera_T_eye = Pose();
  /// Slopes of the side planes, metres aside per metre ahead: left < right, down < up.
  double left = -1.0, right = 1.0, down = -1.0, up = 1.0;
};

/// One picture to draw; arguments as of Renderer::render.
struct ViewRequest {
  const scene::Scene& scene;
  const Camera& camera;
  ImageSize size;
  std::span<std::uint8_t> rgba;
  /// Instead of the camera's own pose and vertical_fov_deg.
  std::optional<EyeView> eye = std::nullopt;
  /// Empty, or height x width: depth along the view axis in metres, not rounded; camera.far_m where
  /// nothing is nearer.
  std::span<float> depth_m{};
};

class Renderer {
 public:
  /// Makes a renderer with its own GL context (OpenGL 4.2 core or later). Sets LP_NUM_THREADS=0 in
  /// the environment unless it is set: Mesa's CPU driver then draws in the calling thread, which is
  /// fastest for small views, and a renderer per thread uses several cores (drawsOnCpu); call it
  /// therefore before other threads read the environment. Throws RenderError that names every
  /// attempt and what to install.
  /// A renderer does not survive fork(): start worker processes afresh (spawn) or create it in the
  /// child. For developers: SIM2VR_EGL_PLATFORM=surfaceless|device picks one EGL platform,
  /// SIM2VR_OSMESA_LIBRARY another OSMesa file, SIM2VR_SHADER_DIR a folder with changed shaders,
  /// SIM2VR_READBACK=direct|ring how pictures come back from the driver (the same bytes).
  static std::shared_ptr<Renderer> create(RendererKind kind = RendererKind::automatic);

  virtual ~Renderer() = default;
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  virtual RendererKind kind() const = 0;

  /// What draws, e.g. "EGL surfaceless: llvmpipe (LLVM 15.0.6, 256 bits), OpenGL 4.5 ...
  /// Mesa 22.3.6".
  virtual const std::string& description() const = 0;

  /// Whether the thread that asks for pictures draws them itself (Mesa's CPU drivers), so that a
  /// renderer per thread draws more. A GPU serves one context at a time and takes about a
  /// millisecond to change to another: there one renderer draws the most
  /// (docs/evidence/training_and_speed.md).
  virtual bool drawsOnCpu() const = 0;

  /// Draws the scene as `camera` sees it (its GameObject's pose; the component need not be enabled)
  /// into `rgba`: uint8, height x width x 4, row 0 = top, no padding. R, G, B: lit scene,
  /// sRGB-encoded, without anti-aliasing. A: depth along the view axis (not along the ray) over
  /// camera.far_m, rounded to the nearest of 255 steps; 255 = sky or beyond far_m. Items with
  /// Material::Blend::alpha and Billboards colour the picture but are absent from A. Meshes give
  /// way to coarser ones where that moves outlines by less than half a pixel (mesh.hpp). Equal
  /// scenes give equal bytes on the same driver. Thread-safe: calls on one renderer take turns, the
  /// GL context is current only during the call, and one that was current before is current again
  /// after. Throws InvalidArgument ("image size", "rgba buffer", "camera...") and RenderError.
  void render(const scene::Scene& scene, const Camera& camera, ImageSize size,
              std::span<std::uint8_t> rgba) {
    const ViewRequest request{scene, camera, size, rgba};
    renderBatch(std::span(&request, 1));
  }

  /// Draws several pictures in one turn; each is the one that render would draw, to the bit. When
  /// it throws, some of the pictures may be missing. Throws InvalidArgument ("eye") for a frustum
  /// without inside.
  virtual void renderBatch(std::span<const ViewRequest> requests) = 0;

 protected:
  Renderer() = default;
  /// Throws InvalidArgument for a bad size or a buffer that does not fit it.
  static void checkRenderArguments(const ViewRequest& request);
};

}  // namespace sim2vr::render
