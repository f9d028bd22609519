// SPDX-License-Identifier: Apache-2.0
// The renderer on OpenGL.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "frame.hpp"
#include "gl_context.hpp"
#include "mesh_cache.hpp"
#include "readback.hpp"
#include "sim2vr/gl/functions.hpp"
#include "sim2vr/render/renderer.hpp"
#include "sky_painter.hpp"

namespace sim2vr::render {

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
  void draw(Prepared& prepared, ImageSize size);
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
