// SPDX-License-Identifier: Apache-2.0
// Brings drawn pictures from the GPU to memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "sim2vr/gl/functions.hpp"
#include "sim2vr/render/image_size.hpp"

namespace sim2vr::render {

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

}  // namespace sim2vr::render
