// SPDX-License-Identifier: Apache-2.0
// Swapchains of a program that draws with OpenGL over EGL. Expected bytes as in pixels_test.cpp.
#define EGL_NO_X11
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#define XR_USE_PLATFORM_EGL
#define XR_USE_GRAPHICS_API_OPENGL
#include <openxr/openxr_platform.h>

#include "graphics.hpp"
#include "sim2vr/gl/functions.hpp"
#include "typed.hpp"

namespace sim2vr::openxr {
namespace {

/// A program with an OpenGL context without a surface.
class Program {
 public:
  /// Text: why there is none here.
  static std::optional<std::string> start(std::optional<Program>& program) {
    void* library = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) return dlerror();
    program.emplace(library);
    if (program->context == EGL_NO_CONTEXT) return "EGL has no surfaceless OpenGL context";
    return std::nullopt;
  }

  explicit Program(void* library) {
    lookup = reinterpret_cast<PFNEGLGETPROCADDRESSPROC>(dlsym(library, "eglGetProcAddress"));
    const auto get_display =
        reinterpret_cast<PFNEGLGETPLATFORMDISPLAYEXTPROC>(lookup("eglGetPlatformDisplayEXT"));
    find(make_current, "eglMakeCurrent");
    find(current, "eglGetCurrentContext");
    find(create_context, "eglCreateContext");
    find(destroy_context, "eglDestroyContext");
    decltype(&eglInitialize) initialize = nullptr;
    find(initialize, "eglInitialize");
    find(bind_api, "eglBindAPI");
    find(query_api, "eglQueryAPI");
    display = get_display(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
    if (display == EGL_NO_DISPLAY || initialize(display, nullptr, nullptr) != EGL_TRUE) return;
    context = createContext(4, 5);
    if (context == EGL_NO_CONTEXT) return;
    make_current(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context);
    gl.emplace([&](const char* name) { return reinterpret_cast<void*>(lookup(name)); },
               [](const char* name) { throw std::runtime_error(name); });
    find(clear_color, "glClearColor");
    find(clear, "glClear");
    find(clear_depth, "glClearDepth");
    find(scissor, "glScissor");
    find(is_texture, "glIsTexture");
    find(gen_buffers, "glGenBuffers");
    find(buffer_data, "glBufferData");
    find(active_texture, "glActiveTexture");
    find(get_tex_parameter, "glGetTexParameteriv");
  }

  EGLContext createContext(int major, int minor) {
    bind_api(EGL_OPENGL_API);
    const std::array<EGLint, 7> attributes = {EGL_CONTEXT_MAJOR_VERSION,
                                              major,
                                              EGL_CONTEXT_MINOR_VERSION,
                                              minor,
                                              EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                              EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                              EGL_NONE};
    return create_context(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes.data());
  }

  XrGraphicsBindingEGLMNDX binding() const {
    auto made = typed<XrGraphicsBindingEGLMNDX>(XR_TYPE_GRAPHICS_BINDING_EGL_MNDX);
    made.getProcAddress = lookup;
    made.display = display;
    made.context = context;
    return made;
  }

  std::unique_ptr<Graphics> graphics() const {
    const XrGraphicsBindingEGLMNDX bound = binding();
    return eglMaker().create(reinterpret_cast<const XrBaseInStructure&>(bound));
  }

  template <class Function>
  void find(Function& function, const char* name) const {
    function = reinterpret_cast<Function>(lookup(name));
    if (function == nullptr) ADD_FAILURE() << "no " << name;
  }

  PFNEGLGETPROCADDRESSPROC lookup = nullptr;
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLContext context = EGL_NO_CONTEXT;
  decltype(&eglMakeCurrent) make_current = nullptr;
  decltype(&eglGetCurrentContext) current = nullptr;
  decltype(&eglCreateContext) create_context = nullptr;
  decltype(&eglDestroyContext) destroy_context = nullptr;
  decltype(&eglBindAPI) bind_api = nullptr;
  decltype(&eglQueryAPI) query_api = nullptr;
  std::optional<gl::Functions> gl;
  PFNGLCLEARCOLORPROC clear_color = nullptr;
  PFNGLCLEARPROC clear = nullptr;
  PFNGLCLEARDEPTHPROC clear_depth = nullptr;
  PFNGLSCISSORPROC scissor = nullptr;
  PFNGLISTEXTUREPROC is_texture = nullptr;
  PFNGLGENBUFFERSPROC gen_buffers = nullptr;
  PFNGLBUFFERDATAPROC buffer_data = nullptr;
  PFNGLACTIVETEXTUREPROC active_texture = nullptr;
  PFNGLGETTEXPARAMETERIVPROC get_tex_parameter = nullptr;
};

XrSwapchainCreateInfo swapchain(GLenum format, std::uint32_t width, std::uint32_t height,
                                std::uint32_t layers = 1, std::uint32_t samples = 1) {
  return swapchainInfo(XR_SWAPCHAIN_USAGE_COLOR_ATTACHMENT_BIT, format, width, height, layers,
                       samples);
}

class GraphicsEgl : public testing::Test {
 protected:
  void SetUp() override {
    const auto problem = Program::start(program_);
    if (problem.has_value()) GTEST_SKIP() << *problem;
    graphics_ = program_->graphics();
  }

  void TearDown() override {
    if (!graphics_) return;
    EXPECT_EQ(gl().GetError(), GLenum{GL_NO_ERROR});
    graphics_.reset();
    program_->make_current(program_->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    program_->destroy_context(program_->display, program_->context);
  }

  const gl::Functions& gl() const { return *program_->gl; }

  static std::vector<GLuint> texturesOf(const SwapchainImages& images) {
    std::vector<XrSwapchainImageOpenGLKHR> list(
        images.count(), typed<XrSwapchainImageOpenGLKHR>(XR_TYPE_SWAPCHAIN_IMAGE_OPENGL_KHR));
    images.describe(reinterpret_cast<XrSwapchainImageBaseHeader*>(list.data()));
    std::vector<GLuint> textures;
    for (const auto& image : list) textures.push_back(image.image);
    return textures;
  }

  /// Clears a rectangle of one layer: what a program draws.
  void draw(GLuint texture, const XrSwapchainCreateInfo& info, std::uint32_t layer,
            const XrRect2Di& rect, const std::array<float, 4>& color) {
    GLuint framebuffer = 0;
    gl().GenFramebuffers(1, &framebuffer);
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    const bool depth = graphics_->isDepth(info.format);
    const bool stencil = info.format == GL_DEPTH24_STENCIL8 || info.format == GL_DEPTH32F_STENCIL8;
    const GLenum attachment = !depth    ? GL_COLOR_ATTACHMENT0
                              : stencil ? GL_DEPTH_STENCIL_ATTACHMENT
                                        : GL_DEPTH_ATTACHMENT;
    if (info.arraySize > 1) {
      gl().FramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, attachment, texture, 0,
                                   static_cast<GLint>(layer));
    } else {
      gl().FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, attachment,
                                info.sampleCount > 1 ? GL_TEXTURE_2D_MULTISAMPLE : GL_TEXTURE_2D,
                                texture, 0);
    }
    ASSERT_EQ(gl().CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER), GLenum{GL_FRAMEBUFFER_COMPLETE});
    gl().Enable(GL_SCISSOR_TEST);
    program_->scissor(rect.offset.x, rect.offset.y, rect.extent.width, rect.extent.height);
    program_->clear_color(color[0], color[1], color[2], color[3]);
    program_->clear_depth(static_cast<double>(color[0]));
    program_->clear(depth ? GL_DEPTH_BUFFER_BIT : GL_COLOR_BUFFER_BIT);
    gl().Disable(GL_SCISSOR_TEST);
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
    gl().DeleteFramebuffers(1, &framebuffer);
  }

  using Color = std::array<int, 4>;
  std::vector<Color> read(const SwapchainImages& images, std::uint32_t index, std::uint32_t layer,
                          const XrRect2Di& rect) {
    const auto width = static_cast<std::uint32_t>(rect.extent.width);
    const auto height = static_cast<std::uint32_t>(rect.extent.height);
    std::vector<std::uint8_t> rgba(std::size_t{width} * height * 4, 77);
    graphics_->readColor({&images, index, layer, rect}, width, height, rgba);
    std::vector<Color> colors;
    for (std::size_t i = 0; i < rgba.size(); i += 4) {
      colors.push_back({rgba[i], rgba[i + 1], rgba[i + 2], rgba[i + 3]});
    }
    return colors;
  }

  std::optional<Program> program_;
  std::unique_ptr<Graphics> graphics_;
};

constexpr XrRect2Di kWhole = {{0, 0}, {6, 4}};

TEST_F(GraphicsEgl, ColoursOfEveryFormat) {
  const std::array<float, 4> drawn = {0.2F, 1.0F, 0.0F, 0.4F};
  const auto shown = [&](GLenum format) {
    const XrSwapchainCreateInfo info = swapchain(format, 6, 4);
    const auto images = graphics_->createImages(info);
    draw(texturesOf(*images)[1], info, 0, kWhole, drawn);
    const std::vector<Color> colors = read(*images, 1, 0, kWhole);
    for (const Color& color : colors) EXPECT_EQ(color, colors.front());
    return colors.front();
  };
  EXPECT_EQ(shown(GL_RGBA8), (Color{124, 255, 0, 102}));
  EXPECT_EQ(shown(GL_RGBA16F), (Color{124, 255, 0, 102}));
  EXPECT_EQ(shown(GL_RGB8), (Color{124, 255, 0, 255}));  // no alpha: opaque
  EXPECT_EQ(shown(GL_RGB16F), (Color{124, 255, 0, 255}));
  EXPECT_EQ(shown(GL_SRGB8), (Color{51, 255, 0, 255}));
  EXPECT_EQ(shown(GL_SRGB8_ALPHA8), (Color{51, 255, 0, 102}));  // bytes stored as they are
  gl().Enable(GL_FRAMEBUFFER_SRGB);                             // the driver encodes linear values
  EXPECT_EQ(shown(GL_SRGB8_ALPHA8), (Color{124, 255, 0, 102}));
  gl().Disable(GL_FRAMEBUFFER_SRGB);
}

TEST_F(GraphicsEgl, TheProgramsTopIsTheFirstRow) {
  const XrSwapchainCreateInfo info = swapchain(GL_SRGB8_ALPHA8, 6, 4);
  const auto images = graphics_->createImages(info);
  const GLuint texture = texturesOf(*images)[0];
  draw(texture, info, 0, kWhole, {0, 0, 1, 1});
  draw(texture, info, 0, {{0, 3}, {2, 1}}, {1, 0, 0, 1});  // OpenGL's upper left corner
  const std::vector<Color> colors = read(*images, 0, 0, kWhole);
  const Color red = {255, 0, 0, 255};
  const Color blue = {0, 0, 255, 255};
  EXPECT_EQ(colors[0], red);
  EXPECT_EQ(colors[1], red);
  for (std::size_t i = 2; i < colors.size(); ++i) EXPECT_EQ(colors[i], blue) << i;
}

TEST_F(GraphicsEgl, HalvesOfADoubleWideImage) {
  const XrSwapchainCreateInfo info = swapchain(GL_SRGB8_ALPHA8, 12, 4);
  const auto images = graphics_->createImages(info);
  const GLuint texture = texturesOf(*images)[2];
  draw(texture, info, 0, {{0, 0}, {6, 4}}, {0, 1, 0, 1});
  draw(texture, info, 0, {{6, 0}, {6, 4}}, {0, 0, 1, 1});
  for (const Color& color : read(*images, 2, 0, {{0, 0}, {6, 4}})) {
    EXPECT_EQ(color, (Color{0, 255, 0, 255}));
  }
  for (const Color& color : read(*images, 2, 0, {{6, 0}, {6, 4}})) {
    EXPECT_EQ(color, (Color{0, 0, 255, 255}));
  }
}

TEST_F(GraphicsEgl, LayersOfAnArray) {
  const XrSwapchainCreateInfo info = swapchain(GL_RGBA8, 6, 4, 2);
  const auto images = graphics_->createImages(info);
  const GLuint texture = texturesOf(*images)[0];
  draw(texture, info, 0, kWhole, {1, 0, 0, 1});
  draw(texture, info, 1, kWhole, {0, 0.2F, 0, 1});
  for (const Color& color : read(*images, 0, 0, kWhole)) EXPECT_EQ(color, (Color{255, 0, 0, 255}));
  for (const Color& color : read(*images, 0, 1, kWhole)) EXPECT_EQ(color, (Color{0, 124, 0, 255}));
}

TEST_F(GraphicsEgl, SamplesAreAveragedOnce) {
  for (const std::uint32_t layers : {1U, 2U}) {
    const XrSwapchainCreateInfo info = swapchain(GL_SRGB8_ALPHA8, 6, 4, layers, 4);
    const auto images = graphics_->createImages(info);
    draw(texturesOf(*images)[0], info, layers - 1, kWhole, {0.2F, 1, 0, 1});
    gl().Enable(GL_SCISSOR_TEST);  // a program's scissor must not cut the picture
    program_->scissor(0, 0, 1, 1);
    for (const Color& color : read(*images, 0, layers - 1, kWhole)) {
      EXPECT_EQ(color, (Color{51, 255, 0, 255}));
    }
    EXPECT_EQ(gl().IsEnabled(GL_SCISSOR_TEST), GLboolean{GL_TRUE});
    gl().Disable(GL_SCISSOR_TEST);
  }
}

TEST_F(GraphicsEgl, DepthOfEveryFormat) {
  for (const std::int64_t format : graphics_->formats()) {
    if (!graphics_->isDepth(format)) continue;
    for (const std::uint32_t samples : {1U, 4U}) {
      const XrSwapchainCreateInfo info = swapchain(static_cast<GLenum>(format), 6, 4, 1, samples);
      const auto images = graphics_->createImages(info);
      draw(texturesOf(*images)[0], info, 0, kWhole, {1, 0, 0, 0});
      draw(texturesOf(*images)[0], info, 0, {{0, 3}, {6, 1}}, {0.25F, 0, 0, 0});
      std::array<float, 24> depth{};
      graphics_->readDepth({images.get(), 0, 0, kWhole}, 6, 4, depth);
      EXPECT_NEAR(depth[0], 0.25F, 1.0F / 65535) << format << " with " << samples;
      EXPECT_NEAR(depth[5], 0.25F, 1.0F / 65535) << format << " with " << samples;
      EXPECT_EQ(depth[6], 1.0F) << format << " with " << samples;
      EXPECT_EQ(depth[23], 1.0F) << format << " with " << samples;
    }
  }
}

TEST_F(GraphicsEgl, MipLevelsAndStaticImages) {
  XrSwapchainCreateInfo info = swapchain(GL_SRGB8_ALPHA8, 8, 4);
  info.mipCount = 3;
  EXPECT_EQ(graphics_->createImages(info)->count(), 3U);
  info.createFlags = XR_SWAPCHAIN_CREATE_STATIC_IMAGE_BIT;
  const auto images = graphics_->createImages(info);
  ASSERT_EQ(images->count(), 1U);
  gl().BindTexture(GL_TEXTURE_2D, texturesOf(*images)[0]);
  GLint levels = 0;
  program_->get_tex_parameter(GL_TEXTURE_2D, GL_TEXTURE_IMMUTABLE_LEVELS, &levels);
  EXPECT_EQ(levels, 3);
  gl().BindTexture(GL_TEXTURE_2D, 0);
}

TEST_F(GraphicsEgl, TheProgramsStateIsAsBefore) {
  // What a program may have set, with values that would spoil our work if they stayed.
  std::array<GLuint, 2> framebuffers{};
  std::array<GLuint, 2> textures{};
  GLuint buffer = 0;
  gl().GenFramebuffers(2, framebuffers.data());
  gl().GenTextures(2, textures.data());
  program_->gen_buffers(1, &buffer);
  program_->active_texture(GL_TEXTURE3);
  gl().BindTexture(GL_TEXTURE_2D, textures[0]);
  gl().BindTexture(GL_TEXTURE_2D_ARRAY, textures[1]);
  gl().BindFramebuffer(GL_READ_FRAMEBUFFER, framebuffers[0]);
  gl().BindBuffer(GL_PIXEL_PACK_BUFFER, buffer);
  program_->buffer_data(GL_PIXEL_PACK_BUFFER, 4096, nullptr, GL_STREAM_READ);
  gl().PixelStorei(GL_PACK_ALIGNMENT, 8);
  gl().PixelStorei(GL_PACK_ROW_LENGTH, 77);
  gl().PixelStorei(GL_PACK_SKIP_ROWS, 2);
  gl().PixelStorei(GL_PACK_SKIP_PIXELS, 3);
  gl().PixelStorei(GL_PACK_SWAP_BYTES, GL_TRUE);
  const auto state = [&] {
    std::vector<GLint> values;
    for (const GLenum name :
         {GL_ACTIVE_TEXTURE, GL_TEXTURE_BINDING_2D, GL_TEXTURE_BINDING_2D_ARRAY,
          GL_TEXTURE_BINDING_2D_MULTISAMPLE, GL_READ_FRAMEBUFFER_BINDING,
          GL_DRAW_FRAMEBUFFER_BINDING, GL_PIXEL_PACK_BUFFER_BINDING, GL_PACK_ALIGNMENT,
          GL_PACK_ROW_LENGTH, GL_PACK_SKIP_ROWS, GL_PACK_SKIP_PIXELS, GL_PACK_SWAP_BYTES,
          GL_SCISSOR_TEST, GL_FRAMEBUFFER_SRGB}) {
      GLint value = 0;
      gl().GetIntegerv(name, &value);
      values.push_back(value);
    }
    return values;
  };
  for (const std::uint32_t samples : {1U, 4U}) {
    const XrSwapchainCreateInfo info = swapchain(GL_RGBA16F, 6, 4, 2, samples);
    const std::vector<GLint> at_first = state();
    const auto images = graphics_->createImages(info);
    EXPECT_EQ(state(), at_first);
    draw(texturesOf(*images)[0], info, 1, kWhole, {0.5F, 0, 0, 1});
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffers[1]);
    const std::vector<GLint> before = state();
    EXPECT_EQ(read(*images, 0, 1, kWhole)[23], (Color{188, 0, 0, 255}));
    EXPECT_EQ(state(), before);
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
  }
}

TEST_F(GraphicsEgl, AnotherCurrentContextStaysCurrent) {
  const XrSwapchainCreateInfo info = swapchain(GL_RGBA8, 6, 4);
  auto images = graphics_->createImages(info);
  const GLuint texture = texturesOf(*images)[0];
  draw(texture, info, 0, kWhole, {0.2F, 0, 0, 1});
  const EGLContext other = program_->createContext(4, 5);
  for (const EGLContext context : {other, EGL_NO_CONTEXT}) {
    program_->make_current(program_->display, EGL_NO_SURFACE, EGL_NO_SURFACE, context);
    program_->bind_api(EGL_OPENGL_ES_API);
    EXPECT_EQ(read(*images, 0, 0, kWhole)[0], (Color{124, 0, 0, 255}));
    EXPECT_EQ(program_->query_api(), EGLenum{EGL_OPENGL_ES_API});
    program_->bind_api(EGL_OPENGL_API);
    EXPECT_EQ(program_->current(), context);
  }
  images.reset();
  program_->make_current(program_->display, EGL_NO_SURFACE, EGL_NO_SURFACE, program_->context);
  EXPECT_EQ(program_->is_texture(texture), GLboolean{GL_FALSE});
  program_->destroy_context(program_->display, other);
}

TEST_F(GraphicsEgl, DestroyedSwapchainsLeaveNoTextures) {
  auto images = graphics_->createImages(swapchain(GL_SRGB8_ALPHA8, 6, 4));
  const std::vector<GLuint> textures = texturesOf(*images);
  for (const GLuint texture : textures)
    EXPECT_EQ(program_->is_texture(texture), GLboolean{GL_TRUE});
  read(*images, 0, 0, kWhole);
  images.reset();
  for (const GLuint texture : textures) {
    EXPECT_EQ(program_->is_texture(texture), GLboolean{GL_FALSE});
  }
}

TEST_F(GraphicsEgl, SwapchainsThatCannotBe) {
  const auto refused = [&](const XrSwapchainCreateInfo& info) {
    try {
      graphics_->createImages(info);
    } catch (const GraphicsError& error) {
      return error.result();
    }
    return XR_SUCCESS;
  };
  XrSwapchainCreateInfo info = swapchain(GL_RGB565, 6, 4);
  EXPECT_EQ(refused(info), XR_ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED);
  EXPECT_EQ(refused(swapchain(GL_RGBA8, 6, 4, 1, 1024)), XR_ERROR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(refused(swapchain(GL_RGBA8, 1U << 20U, 4)), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(refused(swapchain(GL_RGBA8, 6, 4, 1U << 20U)), XR_ERROR_VALIDATION_FAILURE);
  info = swapchain(GL_RGBA8, 6, 6);
  info.faceCount = 6;
  EXPECT_EQ(refused(info), XR_ERROR_FEATURE_UNSUPPORTED);
  info = swapchain(GL_RGBA8, 6, 6);
  info.createFlags = XR_SWAPCHAIN_CREATE_PROTECTED_CONTENT_BIT;
  EXPECT_EQ(refused(info), XR_ERROR_FEATURE_UNSUPPORTED);
}

TEST_F(GraphicsEgl, BindingsThatCannotBe) {
  const auto refused = [&](XrGraphicsBindingEGLMNDX binding) {
    try {
      eglMaker().create(reinterpret_cast<const XrBaseInStructure&>(binding));
    } catch (const GraphicsError& error) {
      return error.result();
    }
    return XR_SUCCESS;
  };
  XrGraphicsBindingEGLMNDX binding = program_->binding();
  binding.getProcAddress = nullptr;
  EXPECT_EQ(refused(binding), XR_ERROR_GRAPHICS_DEVICE_INVALID);
  binding = program_->binding();
  binding.context = EGL_NO_CONTEXT;
  EXPECT_EQ(refused(binding), XR_ERROR_GRAPHICS_DEVICE_INVALID);
  binding = program_->binding();
  binding.display = EGL_NO_DISPLAY;
  EXPECT_EQ(refused(binding), XR_ERROR_GRAPHICS_DEVICE_INVALID);
  program_->bind_api(EGL_OPENGL_ES_API);
  const std::array<EGLint, 3> attributes = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_NONE};
  const EGLContext es = program_->create_context(program_->display, EGL_NO_CONFIG_KHR,
                                                 EGL_NO_CONTEXT, attributes.data());
  program_->bind_api(EGL_OPENGL_API);
  if (es == EGL_NO_CONTEXT) GTEST_SKIP() << "EGL has no OpenGL ES context";
  binding = program_->binding();
  binding.context = es;
  EXPECT_EQ(refused(binding), XR_ERROR_GRAPHICS_DEVICE_INVALID);
  program_->destroy_context(program_->display, es);
}

}  // namespace
}  // namespace sim2vr::openxr
