// SPDX-License-Identifier: Apache-2.0
// Views of an eye: through a frustum that need not be symmetric, from beside the camera.
#include <cmath>

#include "demo_scene.hpp"
#include "picture.hpp"

namespace sim2vr::render::testing {
namespace {

using EyeTest = GlTest;
SIM2VR_FOR_EACH_GL(EyeTest);

Picture drawEye(Renderer& renderer, const scene::Scene& scene, const Camera& camera, ImageSize size,
                const EyeView& eye) {
  Picture picture{size, std::vector<std::uint8_t>(4 * size.pixels(), 77)};
  const ViewRequest request{scene, camera, size, picture.rgba, eye};
  renderer.renderBatch(std::span(&request, 1));
  return picture;
}

// The camera's 90 degrees over 120 x 80 pixels are slopes of 1.5 and 1. A quarter of that frustum
// shows the quarter of the picture: the same rays through the same pixels.
TEST_P(EyeTest, APartOfTheFrustumIsAPartOfThePicture) {
  scene::Scene scene;
  demo::addSurroundings(scene);
  demo::addObjects(scene);
  Camera& camera = demo::addHeadCamera(scene);
  camera.vertical_fov_deg = 90.0;
  const Picture whole = testing::draw(*renderer_, scene, camera, {120, 80});
  const Picture top_right = drawEye(*renderer_, scene, camera, {60, 40},
                                    {.left = 0.0, .right = 1.5, .down = 0.0, .up = 1.0});
  const Picture bottom_left = drawEye(*renderer_, scene, camera, {60, 40},
                                      {.left = -1.5, .right = 0.0, .down = -1.0, .up = 0.0});
  int far_off = 0;
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 60; ++x) {
      far_off += difference(top_right.at(x, y), whole.at(x + 60, y)) > 2 ? 1 : 0;
      far_off += difference(bottom_left.at(x, y), whole.at(x, y + 40)) > 2 ? 1 : 0;
    }
  }
  // Rounding may move an outline by a pixel here and there.
  EXPECT_LE(far_off, 24);
}

TEST_P(EyeTest, AnEyeBesideTheCameraIsACameraThere) {
  scene::Scene scene;
  demo::addSurroundings(scene);
  demo::addObjects(scene);
  Camera& camera = demo::addHeadCamera(scene);
  camera.vertical_fov_deg = 90.0;
  const EyeView eye{
      .camera_T_eye = {Vec3(0.05, 0.0, 0.0), Quat::Identity()}, .left = -1.5, .right = 1.5};
  const Picture seen = drawEye(*renderer_, scene, camera, {120, 80}, eye);
  scene::Transform& transform = camera.transform();
  transform.setPosition(transform.position() + transform.rotation() * Vec3(0.05, 0.0, 0.0));
  const Picture there = testing::draw(*renderer_, scene, camera, {120, 80});
  int far_off = 0;
  for (int y = 0; y < 80; ++y) {
    for (int x = 0; x < 120; ++x) far_off += difference(seen.at(x, y), there.at(x, y)) > 2 ? 1 : 0;
  }
  EXPECT_LE(far_off, 10);
}

TEST_P(EyeTest, AFrustumHasAnInside) {
  scene::Scene scene;
  demo::addSurroundings(scene);
  const Camera& camera = demo::addHeadCamera(scene);
  EXPECT_THROW(drawEye(*renderer_, scene, camera, {8, 8}, EyeView{.left = 1.0, .right = 1.0}),
               InvalidArgument);
}

}  // namespace
}  // namespace sim2vr::render::testing
