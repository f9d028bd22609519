// SPDX-License-Identifier: Apache-2.0
#include "sky_painter.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "shaders.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {
namespace {

/// Looks that are remembered; a moving camera uses one up with every picture.
constexpr std::size_t kLooks = 24;
/// Larger pictures are drawn each time: they are for people and would fill the memory.
constexpr std::size_t kLargestKept_pixels = 512 * 512;

const void* offset(std::size_t bytes) { return reinterpret_cast<const void*>(bytes); }

/// Bits of the side planes that a direction (eye space) lies outside of.
std::uint8_t outsideOf(const View& view, const Eigen::Vector3f& eye) {
  const float x = eye.z() * view.tan_x, y = eye.z() * view.tan_y;
  return static_cast<std::uint8_t>((eye.x() > x ? 1 : 0) | (-eye.x() > x ? 2 : 0) |
                                   (eye.y() > y ? 4 : 0) | (-eye.y() > y ? 8 : 0));
}

}  // namespace

SkyPainter::SkyPainter(const gl::Functions& gl) : gl_(gl), program_(buildProgram(gl, "sky", "")) {
  gl_.GenBuffers(1, &vertex_buffer_);
  gl_.GenBuffers(1, &index_buffer_);
  gl_.GenVertexArrays(1, &array_);
  gl_.BindVertexArray(array_);
  gl_.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, index_buffer_);
  gl_.BindBuffer(GL_ARRAY_BUFFER, vertex_buffer_);
  for (GLuint i = 0; i < 2; ++i) {
    gl_.EnableVertexAttribArray(i);
    gl_.VertexAttribPointer(i, 3, GL_FLOAT, GL_FALSE, static_cast<GLsizei>(sizeof(DomeVertex)),
                            offset(i * sizeof(Eigen::Vector3f)));
  }
}

void SkyPainter::release() {
  for (const Picture& picture : pictures_) drop(picture);
  pictures_.clear();
  gl_.DeleteBuffers(1, &vertex_buffer_);
  gl_.DeleteBuffers(1, &index_buffer_);
  gl_.DeleteVertexArrays(1, &array_);
  gl_.DeleteProgram(program_);
}

void SkyPainter::prepare(Frame& frame) {
  if (!has_dome_ || !(settings_ == frame.sky)) {
    dome_ = makeSkyDome(frame.sky);
    settings_ = frame.sky;
    has_dome_ = true;
    gl_.BindVertexArray(array_);
    gl_.BindBuffer(GL_ARRAY_BUFFER, vertex_buffer_);
    gl_.BufferData(GL_ARRAY_BUFFER,
                   static_cast<GLsizeiptr>(dome_.vertices.size() * sizeof(DomeVertex)),
                   dome_.vertices.data(), GL_STATIC_DRAW);
  }
  const auto set = [](Vec4f& uniform, const Eigen::Vector3f& light) {
    uniform = {light.x(), light.y(), light.z(), 0.0F};
  };
  set(frame.uniforms.sky_high, dome_.high);
  set(frame.uniforms.sky_horizon, dome_.horizon);
  set(frame.uniforms.sky_ground, dome_.ground);
}

GLuint SkyPainter::picture(const Frame& frame, ImageSize size) {
  if (size.pixels() > kLargestKept_pixels) return 0;
  const Look look{size, frame.uniforms.projection, frame.uniforms.depth_scale,
                  frame.uniforms.eye_from_world, frame.sky};
  ++uses_;
  const auto found = std::find_if(pictures_.begin(), pictures_.end(),
                                  [&](const Picture& each) { return each.look == look; });
  if (found != pictures_.end()) {
    found->last_used = uses_;
    if (found->framebuffer == 0) paint(*found, frame);
    return found->framebuffer;
  }
  if (pictures_.size() >= kLooks) {
    const auto oldest = std::min_element(
        pictures_.begin(), pictures_.end(),
        [](const Picture& a, const Picture& b) { return a.last_used < b.last_used; });
    drop(*oldest);
    pictures_.erase(oldest);
  }
  pictures_.push_back({.look = look, .last_used = uses_});
  return 0;
}

void SkyPainter::paint(Picture& picture, const Frame& frame) {
  const ImageSize size = picture.look.size;
  gl_.GenFramebuffers(1, &picture.framebuffer);
  gl_.GenRenderbuffers(1, &picture.color);
  gl_.BindFramebuffer(GL_FRAMEBUFFER, picture.framebuffer);
  gl_.BindRenderbuffer(GL_RENDERBUFFER, picture.color);
  gl_.RenderbufferStorage(GL_RENDERBUFFER, GL_SRGB8_ALPHA8, size.width, size.height);
  gl_.FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, picture.color);
  const GLenum status = gl_.CheckFramebufferStatus(GL_FRAMEBUFFER);
  if (status != GL_FRAMEBUFFER_COMPLETE) {
    drop(picture);
    picture.framebuffer = picture.color = 0;
    throw RenderError(
        fmt::format("a framebuffer of {} x {} pixels for the sky is incomplete ({:#x})", size.width,
                    size.height, status));
  }
  gl_.Viewport(0, 0, size.width, size.height);
  gl_.Disable(GL_BLEND);
  draw(frame);
}

void SkyPainter::drop(const Picture& picture) {
  if (picture.framebuffer == 0) return;
  gl_.DeleteFramebuffers(1, &picture.framebuffer);
  gl_.DeleteRenderbuffers(1, &picture.color);
}

void SkyPainter::draw(const Frame& frame) {
  findVisible(frame);
  if (visible_.empty()) return;
  gl_.Disable(GL_CULL_FACE);
  gl_.UseProgram(program_);
  gl_.BindVertexArray(array_);
  gl_.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, index_buffer_);
  gl_.BufferData(GL_ELEMENT_ARRAY_BUFFER,
                 static_cast<GLsizeiptr>(visible_.size() * sizeof(std::uint16_t)), visible_.data(),
                 GL_STREAM_DRAW);
  gl_.DrawElements(GL_TRIANGLES, static_cast<GLsizei>(visible_.size()), GL_UNSIGNED_SHORT, nullptr);
}

/// The dome's triangles but those that lie outside one of the view's side planes as a whole.
void SkyPainter::findVisible(const Frame& frame) {
  Eigen::Matrix3f eye_from_world;
  for (int row = 0; row < 3; ++row) {
    const Vec4f& r = frame.uniforms.eye_from_world[static_cast<std::size_t>(row)];
    eye_from_world.row(row) << r[0], r[1], r[2];
  }
  outside_.clear();
  for (const DomeVertex& vertex : dome_.vertices) {
    outside_.push_back(outsideOf(frame.view, eye_from_world * vertex.direction));
  }
  visible_.clear();
  const auto& indices = dome_.indices;
  for (std::size_t i = 0; i < indices.size(); i += 3) {
    const int common = outside_[indices[i]] & outside_[indices[i + 1]] & outside_[indices[i + 2]];
    if (common == 0) visible_.insert(visible_.end(), {indices[i], indices[i + 1], indices[i + 2]});
  }
}

}  // namespace sim2vr::render
