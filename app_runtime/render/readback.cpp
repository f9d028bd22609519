// SPDX-License-Identifier: Apache-2.0
#include "readback.hpp"

#include <algorithm>
#include <cstdlib>
#include <string>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {
namespace {

bool wantsRing(bool driver_on_cpu) {
  const char* word = std::getenv("SIM2VR_READBACK");
  if (word == nullptr) return !driver_on_cpu;
  const std::string choice = word;
  if (choice != "direct" && choice != "ring") {
    throw RenderError("SIM2VR_READBACK is '" + choice + "', expected 'direct' or 'ring'");
  }
  return choice == "ring";
}

}  // namespace

Readback::Readback(const gl::Functions& gl, bool driver_on_cpu)
    : gl_(gl), ring_(wantsRing(driver_on_cpu)) {
  if (!ring_) return;
  for (Slot& slot : slots_) gl_.GenBuffers(1, &slot.buffer);
}

void Readback::release() {
  if (!ring_) return;
  for (const Slot& slot : slots_) gl_.DeleteBuffers(1, &slot.buffer);
}

void Readback::begin() {
  for (Slot& slot : slots_) slot.rgba = {};
}

void Readback::read(ImageSize size, std::span<std::uint8_t> rgba) {
  if (!ring_) {
    gl_.ReadPixels(0, 0, size.width, size.height, GL_RGBA, GL_UNSIGNED_BYTE, rgba.data());
    return;
  }
  Slot& slot = slots_[next_];
  next_ = (next_ + 1) % slots_.size();
  fetch(slot);
  gl_.BindBuffer(GL_PIXEL_PACK_BUFFER, slot.buffer);
  if (slot.capacity < rgba.size()) {
    gl_.BufferData(GL_PIXEL_PACK_BUFFER, static_cast<GLsizeiptr>(rgba.size()), nullptr,
                   GL_STREAM_READ);
    slot.capacity = rgba.size();
  }
  gl_.ReadPixels(0, 0, size.width, size.height, GL_RGBA, GL_UNSIGNED_BYTE, nullptr);
  gl_.BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
  slot.rgba = rgba;
}

void Readback::finish() {
  // The oldest first.
  for (std::size_t i = 0; i < slots_.size(); ++i) fetch(slots_[(next_ + i) % slots_.size()]);
}

void Readback::fetch(Slot& slot) {
  if (slot.rgba.empty()) return;
  gl_.BindBuffer(GL_PIXEL_PACK_BUFFER, slot.buffer);
  const auto bytes = static_cast<GLsizeiptr>(slot.rgba.size());
  const void* mapped = gl_.MapBufferRange(GL_PIXEL_PACK_BUFFER, 0, bytes, GL_MAP_READ_BIT);
  if (mapped != nullptr) {
    std::copy_n(static_cast<const std::uint8_t*>(mapped), slot.rgba.size(), slot.rgba.data());
    gl_.UnmapBuffer(GL_PIXEL_PACK_BUFFER);
  }
  gl_.BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
  slot.rgba = {};
  if (mapped == nullptr) throw RenderError("a picture's buffer cannot be mapped");
}

}  // namespace sim2vr::render
