// SPDX-License-Identifier: Apache-2.0
// The renderer on OpenGL.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "frame.hpp"
#include "gl_context.hpp"
#include "sim2vr/gl/functions.hpp"
#include "sim2vr/render/image_size.hpp"
#include "sim2vr/render/renderer.hpp"
#include "sky.hpp"

namespace sim2vr::render {

// Draws the sky behind a picture, or copies it from a picture of it.

/// The sky is half of a small picture's cost, and depends on little: where the camera looks and how
/// wide. Cameras that keep looking the same way (simulated users, whose head is fixed; spectators)
/// get it from a picture that was kept; others get the triangles that they can see.
///
/// All calls need the renderer's context.
class SkyPainter {
 public:
  explicit SkyPainter(const gl::Functions& gl);
  /// Frees what the constructor and later calls made.
  void release();

  /// Computes the dome when the sky changed, and sets the frame's mirrored sky colours.
  void prepare(Frame& frame);

  /// A framebuffer with nothing but this sky, or 0 where none is kept. A look is kept from its
  /// second picture on. May draw: the frame's uniforms are in place, the caller binds its
  /// framebuffer and arrays anew.
  GLuint picture(const Frame& frame, ImageSize size);

  /// Draws what the frame's view sees of the sky, behind everything.
  void draw(const Frame& frame);

 private:
  struct Look {
    ImageSize size;
    Vec4f projection{};
    Vec4f depth_scale{};
    std::array<Vec4f, 3> eye_from_world{};
    SkySettings sky;

    bool operator==(const Look&) const = default;
  };
  struct Picture {
    Look look;
    GLuint framebuffer = 0;
    GLuint color = 0;
    std::uint64_t last_used = 0;
  };

  void findVisible(const Frame& frame);
  void paint(Picture& picture, const Frame& frame);
  void drop(const Picture& picture);

  const gl::Functions& gl_;
  GLuint program_ = 0, array_ = 0, vertex_buffer_ = 0, index_buffer_ = 0;
  bool has_dome_ = false;
  SkySettings settings_;
  SkyDome dome_;
  std::vector<std::uint8_t> outside_;
  std::vector<std::uint16_t> visible_;
  std::vector<Picture> pictures_;
  std::uint64_t uses_ = 0;
};

// Brings drawn pictures from the GPU to memory.

/// Where OpenGL draws on the CPU, a picture is copied at once. A GPU works behind the program's
/// back: there pictures go to a ring of buffers, and are fetched when the ring is full or the batch
/// ends, so that the GPU draws the next ones meanwhile. The bytes are the same.
///
/// All calls need the renderer's context.
class Readback {
 public:
  /// SIM2VR_READBACK=direct|ring overrides what suits the driver, for developers; throws
  /// RenderError for another word.
  Readback(const gl::Functions& gl, bool driver_on_cpu);
  void release();

  /// Forgets what a failed batch left.
  void begin();
  /// Of the bound framebuffer; `rgba` fits and is complete after finish().
  void read(ImageSize size, std::span<std::uint8_t> rgba);
  void finish();

 private:
  struct Slot {
    GLuint buffer = 0;
    std::size_t capacity = 0;
    /// Empty: nothing is on its way.
    std::span<std::uint8_t> rgba;
  };

  void fetch(Slot& slot);

  const gl::Functions& gl_;
  bool ring_ = false;
  std::array<Slot, 4> slots_;
  std::size_t next_ = 0;
};

class GlRenderer final : public Renderer {
 public:
  GlRenderer(RendererKind kind, std::unique_ptr<GlContext> context);
  ~GlRenderer() override;

  RendererKind kind() const override { return kind_; }
  const std::string& description() const override { return description_; }
  bool drawsOnCpu() const override;
  void renderBatch(std::span<const ViewRequest> requests) override;

 private:
  /// A frame and its places in the buffers.
  struct Prepared {
    Frame frame;
    std::size_t first_instance = 0;
    std::size_t uniforms_offset = 0;
  };
  /// A picture to draw into.
  struct Target {
    ImageSize size;
    GLuint framebuffer = 0;
    GLuint color = 0;
    GLuint depth = 0;
    std::uint64_t last_used = 0;
  };

  void setUp();
  void setUpSurfaceArrays();
  GLuint makeBuffer();
  Target& target(ImageSize size);
  Target makeTarget(ImageSize size);
  void dropTarget(const Target& target);
  void renderSome(std::span<const ViewRequest> requests);
  void prepare(const ViewRequest& request, Prepared& prepared);
  std::size_t addUniforms(const FrameUniforms& uniforms);
  void upload();
  void draw(Prepared& prepared, const ViewRequest& request);
  void readDepth(const Frame& frame, const ViewRequest& request);
  void clear(const Frame& frame, GLuint framebuffer, ImageSize size, GLuint sky);
  void drawItems(const std::vector<DrawItem>& items, std::size_t first_instance);
  void applyState(const DrawState& state);
  void checkErrors();

  RendererKind kind_;
  std::unique_ptr<GlContext> context_;
  std::optional<gl::Functions> gl_;
  std::string description_;
  std::mutex mutex_;

  MeshCache meshes_;
  FrameCollector collector_{meshes_};
  std::vector<Prepared> prepared_;
  std::vector<InstanceData> instances_;
  std::vector<std::byte> uniforms_;
  std::size_t uniforms_stride_ = 0;
  std::vector<Target> targets_;
  std::uint64_t frame_number_ = 0;
  std::optional<SkyPainter> sky_;
  std::optional<Readback> readback_;
  std::optional<DrawState> applied_;

  std::array<GLuint, kShadingCount> surface_programs_{};
  std::vector<GLuint> buffers_;
  GLuint vertex_buffer_ = 0, index_buffer_ = 0, instance_buffer_ = 0, uniform_buffer_ = 0;
  GLuint surface_array_ = 0;
};

}  // namespace sim2vr::render
