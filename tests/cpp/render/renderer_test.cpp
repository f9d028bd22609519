// SPDX-License-Identifier: Apache-2.0
// The renderer as an object: kinds, errors, determinism, threads, contexts, caches.
#include "sim2vr/render/renderer.hpp"
#include "own_folder.hpp"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "demo_scene.hpp"
#include "frame.hpp"
#include "gl_context.hpp"
#include "picture.hpp"

namespace sim2vr::render::testing {
namespace {

using RendererTest = GlTest;
SIM2VR_FOR_EACH_GL(RendererTest);

constexpr ImageSize kHeadset{120, 80};

template <class Error, class Call>
std::string messageOf(Call call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "nothing was thrown";
}

/// Sets an environment variable for one test.
class Environment {
 public:
  Environment(const char* name, const std::string& value) : name_(name) {
    setenv(name, value.c_str(), 1);
  }
  ~Environment() { unsetenv(name_); }

 private:
  const char* name_;
};

class DemoWorld {
 public:
  DemoWorld() {
    demo::addSurroundings(scene);
    demo::addObjects(scene);
    camera = &demo::addHeadCamera(scene);
  }
  Picture draw(Renderer& renderer, ImageSize size = kHeadset) const {
    return testing::draw(renderer, scene, *camera, size);
  }
  scene::Scene scene;
  Camera* camera;
};

TEST(RendererKindTest, Names) {
  for (const auto kind :
       {RendererKind::automatic, RendererKind::egl, RendererKind::osmesa, RendererKind::null}) {
    EXPECT_EQ(rendererKindFromName(rendererKindName(kind)), kind);
  }
  EXPECT_EQ(messageOf<InvalidArgument>([] { rendererKindFromName("osmsa"); }),
            "renderer: got 'osmsa', expected 'automatic', 'egl', 'osmesa' or 'null'; did you mean "
            "'osmesa'?");
}

TEST(NullRendererTest, IsBlackAndFar) {
  const auto renderer = Renderer::create(RendererKind::null);
  EXPECT_EQ(renderer->kind(), RendererKind::null);
  EXPECT_EQ(renderer->description(), "null renderer: no pictures");
  const DemoWorld world;
  const Picture picture = world.draw(*renderer, {3, 2});
  for (int i = 0; i < 6; ++i) EXPECT_EQ(picture.at(i % 3, i / 3), (Pixel{0, 0, 0, 255}));
  std::vector<std::uint8_t> rgba(4);
  EXPECT_THROW(renderer->render(world.scene, *world.camera, {0, 1}, rgba), InvalidArgument);
}

TEST_P(RendererTest, SaysWhatDraws) {
  EXPECT_EQ(renderer_->kind(), GetParam());
  const std::string start = GetParam() == RendererKind::egl ? "EGL " : "OSMesa: ";
  EXPECT_EQ(renderer_->description().substr(0, start.size()), start);
  EXPECT_NE(renderer_->description().find(", OpenGL 4."), std::string::npos);
}

TEST_P(RendererTest, RefusesBadSizesAndBuffers) {
  std::vector<std::uint8_t> rgba(4 * 16);
  const auto message = [&](ImageSize size) {
    return messageOf<InvalidArgument>(
        [&] { renderer_->render(world_.scene, world_.camera, size, rgba); });
  };
  EXPECT_EQ(message({0, 4}),
            "image size: got 0 x 4, expected width and height from 1 to 8192 pixels");
  EXPECT_EQ(message({4, -1}),
            "image size: got 4 x -1, expected width and height from 1 to 8192 pixels");
  EXPECT_EQ(message({8193, 4}),
            "image size: got 8193 x 4, expected width and height from 1 to 8192 pixels");
  EXPECT_EQ(message({5, 4}),
            "rgba buffer: got 64 bytes, expected 80 bytes (height 4 x width 5 x 4)");
  EXPECT_NO_THROW(renderer_->render(world_.scene, world_.camera, {4, 4}, rgba));
}

TEST_P(RendererTest, RefusesImpossibleCameras) {
  const auto message = [&] { return messageOf<InvalidArgument>([&] { draw({4, 4}); }); };
  world_.camera.vertical_fov_deg = 180.0;
  EXPECT_EQ(message(),
            "camera.vertical_fov_deg: got 180, expected an angle between 0 and 180 degrees");
  world_.camera.vertical_fov_deg = 90.0;
  world_.camera.near_m = 0.0;
  EXPECT_EQ(message(), "camera.near_m: got 0, expected a finite distance above 0");
  world_.camera.near_m = 20.0;
  EXPECT_EQ(message(), "camera.far_m: got 10, expected a finite distance above near_m = 20");
  world_.camera.near_m = 0.01;
  world_.camera.transform().setLocalPosition({std::nan(""), 0, 0});
  EXPECT_EQ(message(), "camera pose: got a value that is not finite, expected a finite pose");
}

TEST_P(RendererTest, EqualScenesGiveEqualBytes) {
  const DemoWorld one, two;
  const Picture first = one.draw(*renderer_);
  EXPECT_EQ(one.draw(*renderer_).rgba, first.rgba);
  EXPECT_EQ(two.draw(*renderer_).rgba, first.rgba);
  // Nor does it matter what was drawn before, or at which sizes.
  world_.add(sphere(40), matt(kRed), {0, 0, 2});
  for (int edge = 1; edge < 8; ++edge) draw({edge, 9 - edge});
  EXPECT_EQ(one.draw(*renderer_).rgba, first.rgba);
  const auto fresh = Renderer::create(GetParam());
  EXPECT_EQ(two.draw(*fresh).rgba, first.rgba);
}

// From the second picture with one look on, the sky is copied from a picture that was kept.
TEST_P(RendererTest, AKeptSkyIsTheDrawnOne) {
  DemoWorld world;
  for (const double pitch : {-1.4, -0.6, 0.0, 0.17, 0.9, 1.5}) {
    for (const double yaw : {0.0, 0.37, 2.0, 3.1}) {
      world.camera->transform().setLocalRotation(
          Quat(Eigen::AngleAxisd(yaw, Vec3::UnitY()) * Eigen::AngleAxisd(pitch, Vec3::UnitX())));
      const Picture drawn = world.draw(*renderer_);
      const Picture kept = world.draw(*renderer_);
      EXPECT_EQ(drawn.rgba, kept.rgba) << "pitch " << pitch << ", yaw " << yaw;
      EXPECT_EQ(kept.rgba, world.draw(*renderer_).rgba);
    }
  }
}

TEST_P(RendererTest, AKeptSkyIsOfItsSizeLensAndColours) {
  DemoWorld world;
  const auto twice = [&](ImageSize size = kHeadset) {
    const Picture first = world.draw(*renderer_, size);
    EXPECT_EQ(world.draw(*renderer_, size).rgba, first.rgba);
    return first;
  };
  const Picture before = twice();
  twice({160, 80});
  world.camera->vertical_fov_deg = 60.0;
  EXPECT_NE(twice().rgba, before.rgba);
  world.camera->vertical_fov_deg = 90.0;
  EXPECT_EQ(twice().rgba, before.rgba);
  world.scene.forEach<Skybox>([](Skybox& sky) { sky.exposure *= 0.5F; });
  EXPECT_NE(twice().rgba, before.rgba);
  world.scene.forEach<Skybox>([](Skybox& sky) { sky.exposure *= 2.0F; });
  EXPECT_EQ(twice().rgba, before.rgba);
}

TEST_P(RendererTest, ABatchIsTheSinglePictures) {
  DemoWorld world;
  DemoWorld other;
  other.camera->transform().setLocalRotation(Quat(Eigen::AngleAxisd(0.5, Vec3::UnitY())));
  Picture pictures[3] = {{kHeadset, {}}, {kHeadset, {}}, {{64, 48}, {}}};
  for (Picture& picture : pictures) picture.rgba.resize(picture.size.pixels() * 4);
  const std::vector<ViewRequest> requests{{world.scene, *world.camera, kHeadset, pictures[0].rgba},
                                          {other.scene, *other.camera, kHeadset, pictures[1].rgba},
                                          {world.scene, *world.camera, {64, 48}, pictures[2].rgba}};
  renderer_->renderBatch(requests);
  EXPECT_EQ(pictures[0].rgba, world.draw(*renderer_).rgba);
  EXPECT_EQ(pictures[1].rgba, other.draw(*renderer_).rgba);
  EXPECT_EQ(pictures[2].rgba, world.draw(*renderer_, {64, 48}).rgba);
}

/// Demo worlds whose heads look about.
std::vector<std::unique_ptr<DemoWorld>> worldsLookingAbout(int count) {
  std::vector<std::unique_ptr<DemoWorld>> worlds;
  for (int i = 0; i < count; ++i) {
    worlds.push_back(std::make_unique<DemoWorld>());
    worlds.back()->camera->transform().setLocalRotation(
        Quat(Eigen::AngleAxisd(0.05 * (i % 3), Vec3::UnitY())));
    worlds.back()->scene.forEach<Skybox>(
        [&](Skybox& sky) { sky.exposure += i % 2 == 0 ? 0.0F : 0.1F; });
  }
  return worlds;
}

std::vector<Picture> drawTogether(Renderer& renderer,
                                  const std::vector<std::unique_ptr<DemoWorld>>& worlds) {
  const ImageSize other{64, 48};
  std::vector<Picture> pictures;
  for (std::size_t i = 0; i < worlds.size(); ++i) {
    const ImageSize size = i % 5 == 4 ? other : kHeadset;
    pictures.push_back({size, std::vector<std::uint8_t>(4 * size.pixels())});
  }
  std::vector<ViewRequest> requests;
  for (std::size_t i = 0; i < worlds.size(); ++i) {
    requests.push_back({worlds[i]->scene, *worlds[i]->camera, pictures[i].size, pictures[i].rgba});
  }
  renderer.renderBatch(requests);
  return pictures;
}

// More views than are uploaded together, of several looks, skies and sizes, in any order.
TEST_P(RendererTest, ALargeBatchIsTheSinglePictures) {
  const auto worlds = worldsLookingAbout(70);
  const std::vector<Picture> pictures = drawTogether(*renderer_, worlds);
  const auto fresh = Renderer::create(GetParam());
  for (std::size_t i = 0; i < worlds.size(); ++i) {
    const std::size_t backwards = worlds.size() - 1 - i;
    EXPECT_EQ(pictures[backwards].rgba,
              worlds[backwards]->draw(*fresh, pictures[backwards].size).rgba)
        << backwards;
  }
}

TEST_P(RendererTest, AnEmptyBatchDrawsNothing) { EXPECT_NO_THROW(renderer_->renderBatch({})); }

// As on a GPU: pictures come through buffers, several on their way at once.
TEST_P(RendererTest, TheRingOfBuffersBringsTheSamePictures) {
  const Environment ring("SIM2VR_READBACK", "ring");
  const auto renderer = Renderer::create(GetParam());
  for (const int count : {1, 2, 4, 5, 11}) {
    const auto worlds = worldsLookingAbout(count);
    const std::vector<Picture> expected = drawTogether(*renderer_, worlds);
    const std::vector<Picture> pictures = drawTogether(*renderer, worlds);
    for (std::size_t i = 0; i < worlds.size(); ++i) {
      EXPECT_EQ(pictures[i].rgba, expected[i].rgba) << i << " of " << count;
    }
  }
}

TEST_P(RendererTest, AFailedBatchLeavesNothingBehind) {
  for (const char* readback : {"direct", "ring"}) {
    const Environment choice("SIM2VR_READBACK", readback);
    const auto renderer = Renderer::create(GetParam());
    const auto worlds = worldsLookingAbout(66);
    const std::vector<Picture> expected = drawTogether(*renderer, worlds);
    worlds.back()->camera->near_m = -1.0;
    EXPECT_THROW(drawTogether(*renderer, worlds), InvalidArgument);
    worlds.back()->camera->near_m = 0.01;
    const std::vector<Picture> pictures = drawTogether(*renderer, worlds);
    for (std::size_t i = 0; i < worlds.size(); ++i) {
      EXPECT_EQ(pictures[i].rgba, expected[i].rgba) << i;
    }
  }
}

TEST(RendererCreateTest, RefusesAnotherReadback) {
  std::string reason;
  if (rendererOrNull(RendererKind::automatic, reason) == nullptr) GTEST_SKIP() << reason;
  const Environment readback("SIM2VR_READBACK", "pipe");
  const std::string message = messageOf<RenderError>([] { Renderer::create(); });
  EXPECT_NE(message.find("SIM2VR_READBACK is 'pipe', expected 'direct' or 'ring'"),
            std::string::npos)
      << message;
}

TEST_P(RendererTest, ThreadsMayShareARenderer) {
  const DemoWorld world;
  const Picture expected = world.draw(*renderer_);
  const auto other = Renderer::create(GetParam());
  std::array<int, 4> wrong{};
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < wrong.size(); ++t) {
    threads.emplace_back([&, t] {
      const DemoWorld own;
      for (int i = 0; i < 10; ++i) {
        wrong[t] += own.draw(t % 2 == 0 ? *renderer_ : *other).rgba == expected.rgba ? 0 : 1;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, (std::array<int, 4>{}));
}

TEST_P(RendererTest, LeavesTheCallersContextCurrent) {
  const DemoWorld world;
  for (auto* create : {&createEglContext, &createOsMesaContext}) {
    std::unique_ptr<GlContext> context;
    try {
      context = create();
    } catch (const RenderError&) {
      continue;
    }
    using GetString = const unsigned char* (*)(unsigned);
    using GetInteger = void (*)(unsigned, int*);
    const auto get_string = reinterpret_cast<GetString>(context->lookup("glGetString"));
    const auto get_integer = reinterpret_cast<GetInteger>(context->lookup("glGetIntegerv"));
    constexpr unsigned kRenderer = 0x1F01, kCullFace = 0x0B44;
    const auto turn = context->makeCurrent();
    world.draw(*renderer_);
    EXPECT_NE(get_string(kRenderer), nullptr);
    int culling = -1;
    get_integer(kCullFace, &culling);
    EXPECT_EQ(culling, 0) << "the renderer's own state must not show";
  }
}

TEST_P(RendererTest, MayOutliveItsDriverAtExit) {
  // A new process, because drivers do not survive a fork. There the renderer of this fixture lies
  // in a static variable that was made before the driver started, so that it goes after the driver.
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(std::exit(0), ::testing::ExitedWithCode(0), "");
}

TEST_P(RendererTest, MeshesThatAreNotHeldAreLetGo) {
  std::weak_ptr<const Mesh> watched;
  {
    MeshPtr mesh = lathe(std::array{LathePoint{1, 0}, LathePoint{1, 1}}, 8);
    watched = mesh;
    world_.add(mesh, unlit(kWhite), {0, 0, 2}).gameObject();
    draw({8, 8});
    mesh.reset();
    EXPECT_FALSE(watched.expired());
    world_.scene.destroy(*world_.scene.find("Object"));
    world_.scene.runFrame(1, [] {});
  }
  draw({8, 8});
  EXPECT_TRUE(watched.expired());
}

TEST(MeshCacheTest, DropsDeadMeshesAndKeepsLiveOnes) {
  MeshCache cache;
  const MeshPtr kept = box();
  const std::array points = {LathePoint{1, 0}, LathePoint{1, 1}};
  for (int i = 0; i < 5000; ++i) {
    cache.beginFrame();
    cache.slot(kept);
    const MeshPtr brief = lathe(points, 3 + i % 8);
    EXPECT_EQ(cache.slot(brief).index_count, brief->indices.size());
  }
  EXPECT_LT(cache.size(), 520U);
  const MeshSlot& slot = cache.slot(kept);
  ASSERT_EQ(slot.index_count, 36U);
  ASSERT_LE(slot.first_index + slot.index_count, cache.indices().size());
  for (std::uint32_t i = 0; i < slot.index_count; ++i) {
    ASSERT_EQ(cache.indices()[slot.first_index + i], kept->indices[i]);
  }
}

TEST(RendererPairTest, EglAndOsMesaAgree) {
  std::string reason;
  const auto egl = rendererOrNull(RendererKind::egl, reason);
  const auto osmesa = rendererOrNull(RendererKind::osmesa, reason);
  if (egl == nullptr || osmesa == nullptr) GTEST_SKIP() << reason;
  const DemoWorld world;
  const ImageSize size{480, 320};
  const Picture one = world.draw(*egl, size);
  const Picture two = world.draw(*osmesa, size);
  // Edges may fall on the other side of a pixel on another driver; elsewhere 3 levels.
  int edges = 0;
  for (std::size_t i = 0; i < one.rgba.size(); ++i) {
    edges += std::abs(one.rgba[i] - two.rgba[i]) > 3 ? 1 : 0;
  }
  EXPECT_LE(edges, static_cast<int>(one.rgba.size() / 200));
}

TEST(RendererCreateTest, AutomaticNamesEveryAttemptAndThePackage) {
  const Environment egl("SIM2VR_EGL_PLATFORM", "glass");
  const Environment osmesa("SIM2VR_OSMESA_LIBRARY", "libNoSuchMesa.so");
  const std::string message =
      messageOf<RenderError>([] { Renderer::create(RendererKind::automatic); });
  EXPECT_NE(message.find("egl: SIM2VR_EGL_PLATFORM is 'glass', expected 'surfaceless', 'device'"),
            std::string::npos)
      << message;
  EXPECT_NE(message.find("osmesa: OSMesa: libNoSuchMesa.so"), std::string::npos) << message;
  EXPECT_NE(message.find("libosmesa6"), std::string::npos) << message;
  EXPECT_NE(message.find("'null'"), std::string::npos) << message;
}

TEST(RendererCreateTest, AutomaticFallsBackToOsMesa) {
  std::string reason;
  if (rendererOrNull(RendererKind::osmesa, reason) == nullptr) GTEST_SKIP() << reason;
  const Environment egl("SIM2VR_EGL_PLATFORM", "glass");
  EXPECT_EQ(Renderer::create(RendererKind::automatic)->kind(), RendererKind::osmesa);
}

TEST(RendererCreateTest, EglDevicePlatformDrawsTheSame) {
  std::string reason;
  const auto usual = rendererOrNull(RendererKind::egl, reason);
  if (usual == nullptr) GTEST_SKIP() << reason;
  const Environment platform("SIM2VR_EGL_PLATFORM", "device");
  std::shared_ptr<Renderer> device;
  try {
    device = Renderer::create(RendererKind::egl);
  } catch (const RenderError& error) {
    GTEST_SKIP() << error.what();
  }
  EXPECT_EQ(device->description().substr(0, 11), "EGL device ");
  const DemoWorld world;
  const Picture one = world.draw(*usual);
  const Picture two = world.draw(*device);
  int edges = 0;
  for (std::size_t i = 0; i < one.rgba.size(); ++i) {
    edges += std::abs(one.rgba[i] - two.rgba[i]) > 3 ? 1 : 0;
  }
  EXPECT_LE(edges, static_cast<int>(one.rgba.size() / 100));
}

TEST(RendererCreateTest, DevelopersMayReplaceShaders) {
  std::string reason;
  if (rendererOrNull(RendererKind::automatic, reason) == nullptr) GTEST_SKIP() << reason;
  const sim2vr::testing::OwnFolder folder;
  const Environment directory("SIM2VR_SHADER_DIR", folder.path().string());
  EXPECT_NO_THROW(Renderer::create());  // files that are not there come from the library
  std::ofstream(folder / "sky.frag") << "this is no shader\n";
  const std::string message = messageOf<RenderError>([] { Renderer::create(RendererKind::egl); });
  EXPECT_NE(message.find("shader sky.frag"), std::string::npos) << message;
}

}  // namespace
}  // namespace sim2vr::render::testing
