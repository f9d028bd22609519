// SPDX-License-Identifier: Apache-2.0
#include "gl_graphics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>
#include <vector>

#define XR_USE_GRAPHICS_API_OPENGL
#include <openxr/openxr_platform.h>

#include "pixels.hpp"
#include "sim2vr/gl/functions.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::uint32_t kSwapchainImages = 3;

struct GlFormat {
  GLenum internal;
  PixelFormat pixels;  // as glReadPixels delivers them
  GLenum read_format;
  GLenum read_type;
  GLenum attachment;
};

constexpr GLenum kDepthStencil = GL_DEPTH_STENCIL_ATTACHMENT;
constexpr std::array<GlFormat, 11> kFormats = {{
    {GL_SRGB8_ALPHA8, PixelFormat::kRgba8Srgb, GL_RGBA, GL_UNSIGNED_BYTE, GL_COLOR_ATTACHMENT0},
    {GL_SRGB8, PixelFormat::kRgba8Srgb, GL_RGBA, GL_UNSIGNED_BYTE, GL_COLOR_ATTACHMENT0},
    {GL_RGBA8, PixelFormat::kRgba8Linear, GL_RGBA, GL_UNSIGNED_BYTE, GL_COLOR_ATTACHMENT0},
    {GL_RGB8, PixelFormat::kRgba8Linear, GL_RGBA, GL_UNSIGNED_BYTE, GL_COLOR_ATTACHMENT0},
    {GL_RGBA16F, PixelFormat::kRgba16Float, GL_RGBA, GL_HALF_FLOAT, GL_COLOR_ATTACHMENT0},
    {GL_RGB16F, PixelFormat::kRgba16Float, GL_RGBA, GL_HALF_FLOAT, GL_COLOR_ATTACHMENT0},
    {GL_DEPTH_COMPONENT32F, PixelFormat::kDepthFloat, GL_DEPTH_COMPONENT, GL_FLOAT,
     GL_DEPTH_ATTACHMENT},
    {GL_DEPTH24_STENCIL8, PixelFormat::kDepthFloat, GL_DEPTH_COMPONENT, GL_FLOAT, kDepthStencil},
    {GL_DEPTH32F_STENCIL8, PixelFormat::kDepthFloat, GL_DEPTH_COMPONENT, GL_FLOAT, kDepthStencil},
    {GL_DEPTH_COMPONENT24, PixelFormat::kDepthFloat, GL_DEPTH_COMPONENT, GL_FLOAT,
     GL_DEPTH_ATTACHMENT},
    {GL_DEPTH_COMPONENT16, PixelFormat::kDepthFloat, GL_DEPTH_COMPONENT, GL_FLOAT,
     GL_DEPTH_ATTACHMENT},
}};

const GlFormat* findFormat(std::int64_t format) {
  const auto found = std::find_if(kFormats.begin(), kFormats.end(), [&](const GlFormat& one) {
    return static_cast<std::int64_t>(one.internal) == format;
  });
  return found == kFormats.end() ? nullptr : &*found;
}

/// The context and its functions, shared by a session and its swapchains.
struct GlDevice {
  explicit GlDevice(std::unique_ptr<GlContext> made)
      : context(std::move(made)),
        gl([this](const char* name) { return context->lookup(name); },
           [](const char* name) {
             throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                                 fmt::format("the program's driver has no {}", name));
           }) {}

  int integer(GLenum name) const {
    GLint value = 0;
    gl.GetIntegerv(name, &value);
    return value;
  }

  std::unique_ptr<GlContext> context;
  gl::Functions gl;
};

/// The program's context is current while this lives.
class ScopedCurrent {
 public:
  explicit ScopedCurrent(GlContext& context) : context_(context) { context_.enter(); }
  ~ScopedCurrent() { context_.leave(); }
  ScopedCurrent(const ScopedCurrent&) = delete;
  ScopedCurrent& operator=(const ScopedCurrent&) = delete;

 private:
  GlContext& context_;
};

/// Sets what a readback depends on and puts back what the program had.
class ReadState {
 public:
  explicit ReadState(const GlDevice& device) : device_(device) {
    const gl::Functions& gl = device.gl;
    read_ = device.integer(GL_READ_FRAMEBUFFER_BINDING);
    draw_ = device.integer(GL_DRAW_FRAMEBUFFER_BINDING);
    pack_buffer_ = device.integer(GL_PIXEL_PACK_BUFFER_BINDING);
    if (pack_buffer_ != 0) gl.BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    for (std::size_t i = 0; i < kPack.size(); ++i) {
      pack_[i] = device.integer(kPack[i].first);
      if (pack_[i] != kPack[i].second) gl.PixelStorei(kPack[i].first, kPack[i].second);
    }
  }

  ~ReadState() {
    const gl::Functions& gl = device_.gl;
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, static_cast<GLuint>(read_));
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, static_cast<GLuint>(draw_));
    if (pack_buffer_ != 0) {
      gl.BindBuffer(GL_PIXEL_PACK_BUFFER, static_cast<GLuint>(pack_buffer_));
    }
    for (std::size_t i = 0; i < kPack.size(); ++i) {
      if (pack_[i] != kPack[i].second) gl.PixelStorei(kPack[i].first, pack_[i]);
    }
  }
  ReadState(const ReadState&) = delete;
  ReadState& operator=(const ReadState&) = delete;

 private:
  static constexpr std::array<std::pair<GLenum, GLint>, 6> kPack = {{{GL_PACK_ALIGNMENT, 1},
                                                                     {GL_PACK_ROW_LENGTH, 0},
                                                                     {GL_PACK_SKIP_ROWS, 0},
                                                                     {GL_PACK_SKIP_PIXELS, 0},
                                                                     {GL_PACK_SWAP_BYTES, 0},
                                                                     {GL_PACK_LSB_FIRST, 0}}};
  const GlDevice& device_;
  int read_ = 0;
  int draw_ = 0;
  int pack_buffer_ = 0;
  std::array<GLint, kPack.size()> pack_{};
};

/// Switches a capability and puts back what the program had.
class Switched {
 public:
  Switched(const gl::Functions& gl, GLenum what, bool on)
      : gl_(gl), what_(what), before_(gl.IsEnabled(what) != GL_FALSE) {
    set(on);
  }
  ~Switched() { set(before_); }
  Switched(const Switched&) = delete;
  Switched& operator=(const Switched&) = delete;

 private:
  void set(bool on) const {
    if (on) {
      gl_.Enable(what_);
    } else {
      gl_.Disable(what_);
    }
  }

  const gl::Functions& gl_;
  GLenum what_;
  bool before_;
};

struct Shape {
  GLenum target;
  GLenum binding;
};

Shape shapeOf(bool array, bool multisample) {
  if (multisample) {
    return array ? Shape{GL_TEXTURE_2D_MULTISAMPLE_ARRAY, GL_TEXTURE_BINDING_2D_MULTISAMPLE_ARRAY}
                 : Shape{GL_TEXTURE_2D_MULTISAMPLE, GL_TEXTURE_BINDING_2D_MULTISAMPLE};
  }
  return array ? Shape{GL_TEXTURE_2D_ARRAY, GL_TEXTURE_BINDING_2D_ARRAY}
               : Shape{GL_TEXTURE_2D, GL_TEXTURE_BINDING_2D};
}

class GlImages final : public SwapchainImages {
 public:
  GlImages(std::shared_ptr<GlDevice> device, const XrSwapchainCreateInfo& info)
      : format(*findFormat(info.format)),
        width(static_cast<GLsizei>(info.width)),
        height(static_cast<GLsizei>(info.height)),
        layers(static_cast<GLsizei>(info.arraySize)),
        samples(static_cast<GLsizei>(info.sampleCount)),
        device_(std::move(device)),
        mips_(static_cast<GLsizei>(info.mipCount)) {
    const bool once = (info.createFlags & XR_SWAPCHAIN_CREATE_STATIC_IMAGE_BIT) != 0;
    textures_.resize(once ? 1 : kSwapchainImages, 0);
    const ScopedCurrent current(*device_->context);
    const Shape shape = shapeOf(isArray(), samples > 1);
    const auto before = static_cast<GLuint>(device_->integer(shape.binding));
    device_->gl.GenTextures(static_cast<GLsizei>(textures_.size()), textures_.data());
    const bool made = std::all_of(textures_.begin(), textures_.end(),
                                  [&](GLuint texture) { return allocate(shape.target, texture); });
    device_->gl.BindTexture(shape.target, before);
    if (!made) {
      device_->gl.GetError();  // ours: the program must not find it
      device_->gl.DeleteTextures(static_cast<GLsizei>(textures_.size()), textures_.data());
      throw GraphicsError(XR_ERROR_OUT_OF_MEMORY,
                          fmt::format("OpenGL cannot allocate {} textures of {} x {} x {}",
                                      textures_.size(), width, height, layers));
    }
  }

  ~GlImages() override {
    try {
      const ScopedCurrent current(*device_->context);
      device_->gl.DeleteTextures(static_cast<GLsizei>(textures_.size()), textures_.data());
    } catch (const GraphicsError&) {
      // The program's context is gone or busy, and the textures went with it or stay with it.
    }
  }

  std::uint32_t count() const override { return static_cast<std::uint32_t>(textures_.size()); }

  void describe(XrSwapchainImageBaseHeader* images) const override {
    auto* list = reinterpret_cast<XrSwapchainImageOpenGLKHR*>(images);
    for (std::size_t i = 0; i < textures_.size(); ++i) list[i].image = textures_[i];
  }

  /// Attaches one layer of one image to the framebuffer bound as `target`.
  void attach(GLenum target, std::uint32_t index, std::uint32_t layer) const {
    const GLuint texture = textures_.at(index);
    if (isArray()) {
      device_->gl.FramebufferTextureLayer(target, format.attachment, texture, 0,
                                          static_cast<GLint>(layer));
    } else {
      device_->gl.FramebufferTexture2D(target, format.attachment,
                                       shapeOf(false, samples > 1).target, texture, 0);
    }
  }

  const GlFormat& format;
  const GLsizei width;
  const GLsizei height;
  const GLsizei layers;
  const GLsizei samples;

 private:
  bool isArray() const { return layers > 1; }

  bool allocate(GLenum target, GLuint texture) const {
    const gl::Functions& gl = device_->gl;
    gl.BindTexture(target, texture);
    if (samples > 1 && isArray()) {
      gl.TexImage3DMultisample(target, samples, format.internal, width, height, layers, GL_TRUE);
    } else if (samples > 1) {
      gl.TexImage2DMultisample(target, samples, format.internal, width, height, GL_TRUE);
    } else if (isArray()) {
      gl.TexStorage3D(target, mips_, format.internal, width, height, layers);
    } else {
      gl.TexStorage2D(target, mips_, format.internal, width, height);
    }
    GLint got = 0;
    gl.GetTexLevelParameteriv(target, 0, GL_TEXTURE_WIDTH, &got);
    return got == width;
  }

  std::shared_ptr<GlDevice> device_;
  GLsizei mips_;
  std::vector<GLuint> textures_;
};

class GlGraphics final : public Graphics {
 public:
  GlGraphics(std::string_view name, std::unique_ptr<GlContext> context)
      : name_(name), device_(std::make_shared<GlDevice>(std::move(context))) {
    for (const GlFormat& format : kFormats) formats_.push_back(format.internal);
    const ScopedCurrent current(*device_->context);
    checkVersion();
    device_->gl.GenFramebuffers(1, &framebuffer_);
    max_size_ = static_cast<std::uint32_t>(device_->integer(GL_MAX_TEXTURE_SIZE));
    max_layers_ = static_cast<std::uint32_t>(device_->integer(GL_MAX_ARRAY_TEXTURE_LAYERS));
    max_color_samples_ = static_cast<std::uint32_t>(device_->integer(GL_MAX_COLOR_TEXTURE_SAMPLES));
    max_depth_samples_ = static_cast<std::uint32_t>(device_->integer(GL_MAX_DEPTH_TEXTURE_SAMPLES));
  }

  ~GlGraphics() override {
    try {
      const ScopedCurrent current(*device_->context);
      device_->gl.DeleteFramebuffers(1, &framebuffer_);
    } catch (const GraphicsError&) {
      // The framebuffer went with the program's context.
    }
  }

  std::string_view name() const override { return name_; }
  XrStructureType imageType() const override { return XR_TYPE_SWAPCHAIN_IMAGE_OPENGL_KHR; }
  std::span<const std::int64_t> formats() const override { return formats_; }
  bool isDepth(std::int64_t format) const override {
    const GlFormat* found = findFormat(format);
    return found != nullptr && found->attachment != GL_COLOR_ATTACHMENT0;
  }

  std::unique_ptr<SwapchainImages> createImages(const XrSwapchainCreateInfo& info) override {
    check(info);
    return std::make_unique<GlImages>(device_, info);
  }

  /// Reads the part into `staging_`. The state of the program's context is as before.
  PixelView read(const ImagePart& part) override {
    const auto& images = static_cast<const GlImages&>(*part.images);
    const auto width = static_cast<std::uint32_t>(part.rect.extent.width);
    const auto height = static_cast<std::uint32_t>(part.rect.extent.height);
    staging_.resize(std::size_t{width} * height * pixelBytes(images.format.pixels));

    const ScopedCurrent current(*device_->context);
    const ReadState state(*device_);
    const gl::Functions& gl = device_->gl;
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer_);
    images.attach(GL_READ_FRAMEBUFFER, part.index, part.layer);
    if (images.samples > 1) {
      resolveAndRead(images, part.rect);
    } else {
      readPixels(images.format, part.rect);
    }
    gl.FramebufferTexture2D(GL_READ_FRAMEBUFFER, images.format.attachment, GL_TEXTURE_2D, 0, 0);
    return {images.format.pixels, staging_.data(), width, height, true};
  }

 private:
  void checkVersion() const {
    const auto* text = reinterpret_cast<const char*>(device_->gl.GetString(GL_VERSION));
    int major = 0;
    int minor = 0;
    if (text == nullptr || std::sscanf(text, "%d.%d", &major, &minor) != 2 || major < 4 ||
        (major == 4 && minor < 2)) {
      throw GraphicsError(
          XR_ERROR_GRAPHICS_DEVICE_INVALID,
          fmt::format("the program's OpenGL context is '{}', expected OpenGL 4.2 or later",
                      text == nullptr ? "not usable" : text));
    }
  }

  void check(const XrSwapchainCreateInfo& info) const {
    if (findFormat(info.format) == nullptr) {
      throw GraphicsError(
          XR_ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED,
          fmt::format("format {:#x} is none of xrEnumerateSwapchainFormats", info.format));
    }
    if (info.faceCount != 1 ||
        (info.createFlags & XR_SWAPCHAIN_CREATE_PROTECTED_CONTENT_BIT) != 0) {
      throw GraphicsError(XR_ERROR_FEATURE_UNSUPPORTED,
                          "cube maps and protected content are not supported");
    }
    const std::uint32_t most = isDepth(info.format) ? max_depth_samples_ : max_color_samples_;
    if (info.sampleCount > most || (info.sampleCount > 1 && info.mipCount > 1)) {
      throw GraphicsError(
          XR_ERROR_FEATURE_UNSUPPORTED,
          fmt::format("sampleCount is {} with mipCount {}, expected at most {} samples and 1 level",
                      info.sampleCount, info.mipCount, most));
    }
    if (info.width > max_size_ || info.height > max_size_ || info.arraySize > max_layers_) {
      throw GraphicsError(
          XR_ERROR_VALIDATION_FAILURE,
          fmt::format("an image of {} x {} x {} is too large, expected at most {} x {} x {}",
                      info.width, info.height, info.arraySize, max_size_, max_size_, max_layers_));
    }
  }

  void readPixels(const GlFormat& format, const XrRect2Di& rect) {
    device_->gl.ReadPixels(rect.offset.x, rect.offset.y, rect.extent.width, rect.extent.height,
                           format.read_format, format.read_type, staging_.data());
  }

  /// Averages the samples into a texture of one sample, in linear light for sRGB formats.
  void resolveAndRead(const GlImages& images, const XrRect2Di& rect) {
    const gl::Functions& gl = device_->gl;
    const Switched scissor(gl, GL_SCISSOR_TEST, false);
    const Switched encoding(gl, GL_FRAMEBUFFER_SRGB, true);
    const auto before = static_cast<GLuint>(device_->integer(GL_TEXTURE_BINDING_2D));
    GLuint texture = 0;
    GLuint target = 0;
    gl.GenTextures(1, &texture);
    gl.BindTexture(GL_TEXTURE_2D, texture);
    gl.TexStorage2D(GL_TEXTURE_2D, 1, images.format.internal, images.width, images.height);
    gl.BindTexture(GL_TEXTURE_2D, before);
    gl.GenFramebuffers(1, &target);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, target);
    gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, images.format.attachment, GL_TEXTURE_2D, texture,
                            0);
    const bool color = images.format.attachment == GL_COLOR_ATTACHMENT0;
    gl.BlitFramebuffer(0, 0, images.width, images.height, 0, 0, images.width, images.height,
                       color ? GL_COLOR_BUFFER_BIT : GL_DEPTH_BUFFER_BIT, GL_NEAREST);
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, target);
    readPixels(images.format, rect);
    gl.DeleteFramebuffers(1, &target);
    gl.DeleteTextures(1, &texture);
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer_);
  }

  std::string_view name_;
  std::shared_ptr<GlDevice> device_;
  std::vector<std::int64_t> formats_;
  GLuint framebuffer_ = 0;
  std::uint32_t max_size_ = 0;
  std::uint32_t max_layers_ = 0;
  std::uint32_t max_color_samples_ = 0;
  std::uint32_t max_depth_samples_ = 0;
  std::vector<std::byte> staging_;  // reused from frame to frame
};

XrResult XRAPI_CALL getRequirements(XrInstance instance, XrSystemId system,
                                    XrGraphicsRequirementsOpenGLKHR* requirements) {
  constexpr const char* kCall = "xrGetOpenGLGraphicsRequirementsKHR";
  const XrResult result =
      graphicsCall(kCall, instance, system, XR_KHR_OPENGL_ENABLE_EXTENSION_NAME);
  if (result != XR_SUCCESS) return result;
  if (requirements == nullptr || requirements->type != XR_TYPE_GRAPHICS_REQUIREMENTS_OPENGL_KHR) {
    return graphicsFailed(kCall, XR_ERROR_VALIDATION_FAILURE,
                          "graphicsRequirements is not a XrGraphicsRequirementsOpenGLKHR");
  }
  requirements->minApiVersionSupported = XR_MAKE_VERSION(4, 2, 0);
  requirements->maxApiVersionSupported = XR_MAKE_VERSION(4, 6, 0);
  return XR_SUCCESS;
}

}  // namespace

std::unique_ptr<Graphics> createGlGraphics(std::string_view name,
                                           std::unique_ptr<GlContext> context) {
  return std::make_unique<GlGraphics>(name, std::move(context));
}

PFN_xrVoidFunction glRequirementsFunction(std::string_view name) {
  if (name != "xrGetOpenGLGraphicsRequirementsKHR") return nullptr;
  return reinterpret_cast<PFN_xrVoidFunction>(getRequirements);
}

}  // namespace sim2vr::openxr
