// SPDX-License-Identifier: Apache-2.0
// Helpers of the render tests: pictures whose pixels can be read, and a scene with a camera.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/render/renderer.hpp"

namespace sim2vr::render::testing {

using Pixel = std::array<int, 4>;

struct Picture {
  ImageSize size;
  std::vector<std::uint8_t> rgba;

  Pixel at(int x, int y) const {
    const std::size_t i = 4 * static_cast<std::size_t>(y * size.width + x);
    return {rgba[i], rgba[i + 1], rgba[i + 2], rgba[i + 3]};
  }
};

/// Largest channel difference; `channels` = 3 leaves out the depth.
inline int difference(const Pixel& a, const Pixel& b, std::size_t channels = 4) {
  int largest = 0;
  for (std::size_t i = 0; i < channels; ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

inline int difference(const Picture& a, const Picture& b) {
  int largest = 0;
  for (std::size_t i = 0; i < a.rgba.size(); ++i) {
    largest = std::max(largest, std::abs(a.rgba[i] - b.rgba[i]));
  }
  return largest;
}

inline Picture draw(Renderer& renderer, const scene::Scene& scene, const Camera& camera,
                    ImageSize size) {
  Picture picture{size, std::vector<std::uint8_t>(4 * size.pixels(), 77)};
  renderer.render(scene, camera, size, picture.rgba);
  return picture;
}

inline Quat turned(double degrees, const Vec3& axis) {
  return Quat(Eigen::AngleAxisd(degrees * std::numbers::pi / 180.0, axis));
}

inline Material unlit(Color color) {
  Material material;
  material.albedo = color;
  material.unlit = true;
  return material;
}

/// Lambert only.
inline Material matt(Color color) {
  Material material;
  material.albedo = color;
  material.specular_highlights = false;
  material.sky_reflections = false;
  return material;
}

constexpr Color kWhite{1, 1, 1, 1};
constexpr Color kRed{1, 0, 0, 1};
constexpr Color kGreen{0, 1, 0, 1};

/// Null and a reason to skip where the machine has no such renderer. One per kind and process.
inline std::shared_ptr<Renderer> rendererOrNull(RendererKind kind, std::string& reason) {
  static std::array<std::shared_ptr<Renderer>, 4> renderers;
  auto& renderer = renderers[static_cast<std::size_t>(kind)];
  if (renderer != nullptr) return renderer;
  try {
    renderer = Renderer::create(kind);
  } catch (const RenderError& error) {
    reason = error.what();
  }
  return renderer;
}

/// A scene seen by a camera at the origin that looks along +z.
class World {
 public:
  World() : camera(scene.create("Camera").addComponent<Camera>()) {}

  MeshRenderer& add(const MeshPtr& mesh, const Material& material, const Vec3& position,
                    const Vec3& scale = Vec3::Ones(), const Quat& rotation = Quat::Identity()) {
    scene::GameObject& object = scene.create("Object");
    object.transform().setLocalPosition(position);
    object.transform().setLocalScale(scale);
    object.transform().setLocalRotation(rotation);
    return object.addComponent<MeshRenderer>(mesh, material);
  }
  DirectionalLight& addLight(const Vec3& direction_of_travel, float intensity = 1.0F) {
    scene::GameObject& object = scene.create("Light");
    object.transform().setRotation(Quat::FromTwoVectors(Vec3::UnitZ(), direction_of_travel));
    auto& light = object.addComponent<DirectionalLight>();
    light.intensity = intensity;
    return light;
  }

  scene::Scene scene;
  Camera& camera;
};

/// Runs once per GL renderer; skips, with the reason, where one does not start.
class GlTest : public ::testing::TestWithParam<RendererKind> {
 protected:
  void SetUp() override {
    std::string reason;
    renderer_ = rendererOrNull(GetParam(), reason);
    if (renderer_ == nullptr) GTEST_SKIP() << reason;
  }
  Picture draw(ImageSize size) {
    return testing::draw(*renderer_, world_.scene, world_.camera, size);
  }

  std::shared_ptr<Renderer> renderer_;
  World world_;
};

inline std::string kindName(const ::testing::TestParamInfo<RendererKind>& info) {
  return std::string(rendererKindName(info.param));
}

#define SIM2VR_FOR_EACH_GL(suite)                                                                 \
  INSTANTIATE_TEST_SUITE_P(                                                                       \
      Gl, suite,                                                                                  \
      ::testing::Values(sim2vr::render::RendererKind::egl, sim2vr::render::RendererKind::osmesa), \
      sim2vr::render::testing::kindName)

}  // namespace sim2vr::render::testing
