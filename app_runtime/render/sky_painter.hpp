// SPDX-License-Identifier: Apache-2.0
// Draws the sky behind a picture, or copies it from a picture of it.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "frame.hpp"
#include "sim2vr/gl/functions.hpp"
#include "sky.hpp"

namespace sim2vr::render {

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

}  // namespace sim2vr::render
