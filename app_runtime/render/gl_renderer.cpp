// SPDX-License-Identifier: Apache-2.0
#include "gl_renderer.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "frame.hpp"
#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"

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

bool wantsRing(bool driver_on_cpu) {
  const char* word = std::getenv("SIM2VR_READBACK");
  if (word == nullptr) return !driver_on_cpu;
  const std::string choice = word;
  if (choice != "direct" && choice != "ring") {
    throw RenderError("SIM2VR_READBACK is '" + choice + "', expected 'direct' or 'ring'");
  }
  return choice == "ring";
}

/// Pictures of different sizes that stay allocated.
constexpr std::size_t kMaxTargets = 4;

/// Views whose data is uploaded together; bounds the memory of large batches.
constexpr std::size_t kMostTogether = 64;

/// Set when the process exits, before the drivers take themselves down. A renderer in a static
/// variable may outlive its driver and must then let everything lie.
std::atomic<bool> process_exits = false;

/// Exit handlers run in reverse order, so this one has to come after the driver's own: once the
/// first context of each kind works.
void watchExit(RendererKind kind) {
  static std::array<std::once_flag, 4> once;
  std::call_once(once.at(static_cast<std::size_t>(kind)),
                 [] { std::atexit([] { process_exits = true; }); });
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

GlRenderer::GlRenderer(RendererKind kind, std::unique_ptr<GlContext> context)
    : kind_(kind), context_(std::move(context)) {
  const auto current = context_->makeCurrent();
  gl_.emplace([this](const char* name) { return context_->lookup(name); },
              [](const char* name) {
                throw RenderError(fmt::format("the driver has no {} (OpenGL 4.2 is needed)", name));
              });
  const auto text = [this](GLenum name) {
    const auto* bytes = gl_->GetString(name);
    return std::string(bytes == nullptr ? "?" : reinterpret_cast<const char*>(bytes));
  };
  description_ =
      fmt::format("{}: {}, OpenGL {}", context_->platform(), text(GL_RENDERER), text(GL_VERSION));
  setUp();
  checkErrors();
  watchExit(kind_);
  logger().info("renderer: {}", description_);
}

GlRenderer::~GlRenderer() {
  if (process_exits) {
    static_cast<void>(context_.release());
    return;
  }
  try {
    const auto current = context_->makeCurrent();
    for (const Target& each : targets_) dropTarget(each);
    gl_->DeleteBuffers(static_cast<GLsizei>(buffers_.size()), buffers_.data());
    gl_->DeleteVertexArrays(1, &surface_array_);
    sky_->release();
    readback_->release();
    for (const GLuint program : surface_programs_) gl_->DeleteProgram(program);
  } catch (const RenderError& error) {
    logger().warn("renderer: not cleaned up: {}", error.what());
  }
}

/// Mesa's drivers say so by their names.
bool GlRenderer::drawsOnCpu() const {
  return description_.find("llvmpipe") != std::string::npos ||
         description_.find("softpipe") != std::string::npos;
}

GLuint GlRenderer::makeBuffer() {
  GLuint buffer = 0;
  gl_->GenBuffers(1, &buffer);
  buffers_.push_back(buffer);
  return buffer;
}

void GlRenderer::setUp() {
  surface_programs_ = {buildProgram(*gl_, "surface", "SHADING_UNLIT"),
                       buildProgram(*gl_, "surface", "SHADING_DIFFUSE"),
                       buildProgram(*gl_, "surface", "SHADING_SPECULAR")};
  setUpSurfaceArrays();
  sky_.emplace(*gl_);
  readback_.emplace(*gl_, drawsOnCpu());
  uniform_buffer_ = makeBuffer();
  GLint alignment = 1;
  gl_->GetIntegerv(GL_UNIFORM_BUFFER_OFFSET_ALIGNMENT, &alignment);
  const auto unit = static_cast<std::size_t>(std::max(alignment, 1));
  uniforms_stride_ = (sizeof(FrameUniforms) + unit - 1) / unit * unit;
  // The context is this renderer's own: what is set here stays.
  gl_->Enable(GL_FRAMEBUFFER_SRGB);
  gl_->Enable(GL_DEPTH_TEST);
  // Colours blend, the depth channel keeps what opaque items wrote.
  gl_->BlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ZERO, GL_ONE);
}

void GlRenderer::setUpSurfaceArrays() {
  vertex_buffer_ = makeBuffer();
  index_buffer_ = makeBuffer();
  instance_buffer_ = makeBuffer();
  gl_->GenVertexArrays(1, &surface_array_);
  gl_->BindVertexArray(surface_array_);
  gl_->BindBuffer(GL_ELEMENT_ARRAY_BUFFER, index_buffer_);
  gl_->BindBuffer(GL_ARRAY_BUFFER, vertex_buffer_);
  constexpr auto kVertexSize = static_cast<GLsizei>(sizeof(MeshCache::GpuVertex));
  for (GLuint i = 0; i < 2; ++i) {
    gl_->EnableVertexAttribArray(i);
    gl_->VertexAttribPointer(i, 3, GL_FLOAT, GL_FALSE, kVertexSize, offset(i * 3 * sizeof(float)));
  }
  gl_->BindBuffer(GL_ARRAY_BUFFER, instance_buffer_);
  constexpr GLuint kFirst = 2;
  constexpr GLuint kCount = sizeof(InstanceData) / sizeof(Vec4f);
  for (GLuint i = 0; i < kCount; ++i) {
    gl_->EnableVertexAttribArray(kFirst + i);
    gl_->VertexAttribPointer(kFirst + i, 4, GL_FLOAT, GL_FALSE,
                             static_cast<GLsizei>(sizeof(InstanceData)), offset(i * sizeof(Vec4f)));
    gl_->VertexAttribDivisor(kFirst + i, 1);
  }
}

GlRenderer::Target& GlRenderer::target(ImageSize size) {
  auto found = std::find_if(targets_.begin(), targets_.end(),
                            [&](const Target& each) { return each.size == size; });
  if (found == targets_.end()) {
    if (targets_.size() >= kMaxTargets) {
      const auto oldest = std::min_element(
          targets_.begin(), targets_.end(),
          [](const Target& a, const Target& b) { return a.last_used < b.last_used; });
      dropTarget(*oldest);
      targets_.erase(oldest);
    }
    targets_.push_back(makeTarget(size));
    found = targets_.end() - 1;
  }
  found->last_used = frame_number_;
  return *found;
}

GlRenderer::Target GlRenderer::makeTarget(ImageSize size) {
  Target made;
  made.size = size;
  gl_->GenFramebuffers(1, &made.framebuffer);
  gl_->GenRenderbuffers(1, &made.color);
  gl_->GenRenderbuffers(1, &made.depth);
  gl_->BindFramebuffer(GL_FRAMEBUFFER, made.framebuffer);
  gl_->BindRenderbuffer(GL_RENDERBUFFER, made.color);
  gl_->RenderbufferStorage(GL_RENDERBUFFER, GL_SRGB8_ALPHA8, size.width, size.height);
  gl_->FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, made.color);
  gl_->BindRenderbuffer(GL_RENDERBUFFER, made.depth);
  gl_->RenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT32F, size.width, size.height);
  gl_->FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, made.depth);
  const GLenum status = gl_->CheckFramebufferStatus(GL_FRAMEBUFFER);
  if (status != GL_FRAMEBUFFER_COMPLETE) {
    dropTarget(made);
    throw RenderError(fmt::format("{}: a framebuffer of {} x {} pixels is incomplete ({:#x})",
                                  description_, size.width, size.height, status));
  }
  return made;
}

void GlRenderer::dropTarget(const Target& target) {
  gl_->DeleteFramebuffers(1, &target.framebuffer);
  gl_->DeleteRenderbuffers(1, &target.color);
  gl_->DeleteRenderbuffers(1, &target.depth);
}

// One view at a time: an atlas of all views makes the CPU's caches overflow, and shifted viewports
// round differently. The views share the current context and the uploads.
void GlRenderer::renderBatch(std::span<const ViewRequest> requests) {
  for (const ViewRequest& each : requests) checkRenderArguments(each);
  if (requests.empty()) return;
  const std::lock_guard lock(mutex_);
  const auto current = context_->makeCurrent();
  readback_->begin();
  for (std::size_t i = 0; i < requests.size(); i += kMostTogether) {
    renderSome(requests.subspan(i, std::min(kMostTogether, requests.size() - i)));
  }
  readback_->finish();
  checkErrors();
}

void GlRenderer::renderSome(std::span<const ViewRequest> requests) {
  if (prepared_.size() < requests.size()) prepared_.resize(requests.size());
  instances_.clear();
  uniforms_.clear();
  for (std::size_t i = 0; i < requests.size(); ++i) prepare(requests[i], prepared_[i]);
  upload();
  for (std::size_t i = 0; i < requests.size(); ++i) {
    draw(prepared_[i], requests[i]);
    readback_->read(requests[i].size, requests[i].rgba);
    if (!requests[i].depth_m.empty()) readDepth(prepared_[i].frame, requests[i]);
  }
}

/// Of the bound framebuffer. The projection is undone: z / w = scale + offset / depth.
void GlRenderer::readDepth(const Frame& frame, const ViewRequest& request) {
  gl_->ReadPixels(0, 0, request.size.width, request.size.height, GL_DEPTH_COMPONENT, GL_FLOAT,
                  request.depth_m.data());
  const float scale = frame.uniforms.projection[2], offset = frame.uniforms.projection[3];
  for (float& each : request.depth_m) {
    each = each < 1.0F ? std::min(offset / (2.0F * each - 1.0F - scale), frame.view.far_m)
                       : frame.view.far_m;
  }
}

void GlRenderer::prepare(const ViewRequest& request, Prepared& prepared) {
  Frame& frame = prepared.frame;
  collector_.collect(request, frame);
  if (frame.has_sky) sky_->prepare(frame);
  prepared.first_instance = instances_.size();
  for (const auto* items : {&frame.opaque, &frame.alpha}) {
    for (const DrawItem& item : *items) instances_.push_back(frame.instances[item.instance]);
  }
  prepared.uniforms_offset = addUniforms(frame.uniforms);
}

/// Views of players who look the same way share their uniforms.
std::size_t GlRenderer::addUniforms(const FrameUniforms& uniforms) {
  const std::size_t end = uniforms_.size();
  if (end > 0 && std::memcmp(&uniforms_[end - uniforms_stride_], &uniforms, sizeof uniforms) == 0) {
    return end - uniforms_stride_;
  }
  uniforms_.resize(end + uniforms_stride_);
  std::memcpy(&uniforms_[end], &uniforms, sizeof uniforms);
  return end;
}

void GlRenderer::upload() {
  gl_->BindVertexArray(surface_array_);
  if (meshes_.takeChanged()) {
    const auto& vertices = meshes_.vertices();
    const auto& indices = meshes_.indices();
    gl_->BindBuffer(GL_ARRAY_BUFFER, vertex_buffer_);
    gl_->BufferData(GL_ARRAY_BUFFER,
                    static_cast<GLsizeiptr>(vertices.size() * sizeof(MeshCache::GpuVertex)),
                    vertices.data(), GL_STATIC_DRAW);
    gl_->BufferData(GL_ELEMENT_ARRAY_BUFFER,
                    static_cast<GLsizeiptr>(indices.size() * sizeof(std::uint32_t)), indices.data(),
                    GL_STATIC_DRAW);
  }
  gl_->BindBuffer(GL_ARRAY_BUFFER, instance_buffer_);
  gl_->BufferData(GL_ARRAY_BUFFER,
                  static_cast<GLsizeiptr>(instances_.size() * sizeof(InstanceData)),
                  instances_.data(), GL_STREAM_DRAW);
  gl_->BindBuffer(GL_UNIFORM_BUFFER, uniform_buffer_);
  gl_->BufferData(GL_UNIFORM_BUFFER, static_cast<GLsizeiptr>(uniforms_.size()), uniforms_.data(),
                  GL_STREAM_DRAW);
}

void GlRenderer::draw(Prepared& prepared, const ViewRequest& request) {
  Frame& frame = prepared.frame;
  const ImageSize size = request.size;
  ++frame_number_;
  gl_->BindBufferRange(GL_UNIFORM_BUFFER, 0, uniform_buffer_,
                       static_cast<GLintptr>(prepared.uniforms_offset), sizeof(FrameUniforms));
  GLuint sky = 0;
  if (frame.has_sky) {
    sky_->prepare(frame);  // another view of the batch may have had another sky
    // The gaze never stays: keeping its skies would drop those of the headset's views.
    if (request.depth_m.empty()) sky = sky_->picture(frame, size);
  }
  const GLuint framebuffer = target(size).framebuffer;
  gl_->BindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  gl_->Viewport(0, 0, size.width, size.height);
  gl_->BindVertexArray(surface_array_);
  applied_.reset();
  clear(frame, framebuffer, size, sky);
  drawItems(frame.opaque, prepared.first_instance);
  gl_->DepthMask(GL_FALSE);
  gl_->DepthFunc(GL_LEQUAL);
  if (frame.has_sky && sky == 0) {
    sky_->draw(frame);
    applied_.reset();
  }
  if (frame.alpha.empty()) return;
  gl_->Enable(GL_BLEND);
  gl_->BindVertexArray(surface_array_);
  drawItems(frame.alpha, prepared.first_instance + frame.opaque.size());
}

/// Ready for opaque items. `sky`: a framebuffer to copy the sky from; 0: it is drawn later.
void GlRenderer::clear(const Frame& frame, GLuint framebuffer, ImageSize size, GLuint sky) {
  gl_->Disable(GL_BLEND);
  gl_->DepthMask(GL_TRUE);
  gl_->DepthFunc(GL_LESS);
  if (sky == 0) {
    gl_->ClearColor(frame.background[0], frame.background[1], frame.background[2], 1.0F);
    gl_->Clear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    return;
  }
  gl_->BindFramebuffer(GL_READ_FRAMEBUFFER, sky);
  gl_->BlitFramebuffer(0, 0, size.width, size.height, 0, 0, size.width, size.height,
                       GL_COLOR_BUFFER_BIT, GL_NEAREST);
  gl_->BindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer);
  gl_->Clear(GL_DEPTH_BUFFER_BIT);
}

void GlRenderer::drawItems(const std::vector<DrawItem>& items, std::size_t first_instance) {
  std::size_t begin = 0;
  while (begin < items.size()) {
    const DrawItem& item = items[begin];
    std::size_t end = begin + 1;
    while (end < items.size() && items[end].mesh == item.mesh && items[end].state == item.state) {
      ++end;
    }
    applyState(item.state);
    gl_->DrawElementsInstancedBaseVertexBaseInstance(
        GL_TRIANGLES, static_cast<GLsizei>(item.mesh->index_count), GL_UNSIGNED_INT,
        offset(item.mesh->first_index * sizeof(std::uint32_t)), static_cast<GLsizei>(end - begin),
        item.mesh->base_vertex, static_cast<GLuint>(first_instance + begin));
    begin = end;
  }
}

void GlRenderer::applyState(const DrawState& state) {
  if (applied_ == state) return;
  gl_->UseProgram(surface_programs_[static_cast<std::size_t>(state.shading)]);
  (state.cull_back ? gl_->Enable : gl_->Disable)(GL_CULL_FACE);
  // Unity's fronts are clockwise; the upside-down picture turns them counter-clockwise.
  gl_->FrontFace(state.mirrored ? GL_CW : GL_CCW);
  applied_ = state;
}

void GlRenderer::checkErrors() {
  const GLenum error = gl_->GetError();
  if (error != GL_NO_ERROR) {
    throw RenderError(fmt::format("{}: OpenGL error {:#x}", description_, error));
  }
}

}  // namespace sim2vr::render
