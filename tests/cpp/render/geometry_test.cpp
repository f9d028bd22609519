// SPDX-License-Identifier: Apache-2.0
// Where things appear: orientation, field of view, depth channel, clipping, culling.
#include "picture.hpp"

namespace sim2vr::render::testing {
namespace {

using GeometryTest = GlTest;
SIM2VR_FOR_EACH_GL(GeometryTest);

constexpr ImageSize kSmall{60, 40};

TEST_P(GeometryTest, RowZeroIsTheTopAndPlusXIsRight) {
  world_.add(quad(), unlit(kRed), {0.8, 0.6, 1.0}, Vec3::Constant(0.2));
  world_.add(quad(), unlit(kGreen), {-0.8, -0.6, 1.0}, Vec3::Constant(0.2));
  const Picture picture = draw(kSmall);
  // tan 45 deg = 1 half height: x 0.8 is column (0.8 / 1.5 + 1) / 2 * 60 = 46, y 0.6 row 8.
  EXPECT_EQ(picture.at(46, 8), (Pixel{255, 0, 0, 26}));
  EXPECT_EQ(picture.at(14, 32), (Pixel{0, 255, 0, 26}));
  EXPECT_EQ(picture.at(14, 8), (Pixel{0, 0, 0, 255}));
}

TEST_P(GeometryTest, CameraPoseTurnsThePicture) {
  world_.camera.transform().setPose({{5, 1, 2}, turned(90, Vec3::UnitY())});  // looks along +x
  world_.add(quad(), unlit(kRed), {6, 1, 1.4}, Vec3::Constant(0.2), turned(90, Vec3::UnitY()));
  // World -z is to the right of a viewer that looks along +x: 0.6 -> column (0.6 / 1.5 + 1) * 30
  // = 42.
  EXPECT_EQ(draw(kSmall).at(42, 20), (Pixel{255, 0, 0, 26}));
}

TEST_P(GeometryTest, VerticalFieldOfView) {
  world_.camera.vertical_fov_deg = 60.0;
  world_.add(quad(), unlit(kWhite), {0.3, 0.21, 1.0}, Vec3::Constant(0.06));
  const ImageSize size{404, 202};
  const Picture picture = draw(size);
  double x_sum = 0, y_sum = 0, count = 0;
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      if (picture.at(x, y)[0] == 0) continue;
      x_sum += x + 0.5;
      y_sum += y + 0.5;
      ++count;
    }
  }
  ASSERT_GT(count, 50);
  // 101 pixels per tan 30 deg = 0.57735: centre column 202 + 52.481, centre row 101 - 36.737.
  EXPECT_NEAR(x_sum / count, 254.481, 0.5);
  EXPECT_NEAR(y_sum / count, 64.263, 0.5);
}

TEST_P(GeometryTest, DepthIsDistanceAlongTheAxisEverywhere) {
  // 0.2, 0.33 and 0.25 of far = 10 m; 84.15 -> 84 and 63.75 -> 64: to the nearest step.
  for (const auto& [z, step] : {std::pair{2.0, 51}, std::pair{3.3, 84}, std::pair{2.5, 64}}) {
    World world;
    world.add(quad(), unlit(kWhite), {0, 0, z}, Vec3::Constant(20.0));
    const Picture picture = testing::draw(*renderer_, world.scene, world.camera, kSmall);
    for (int y = 0; y < kSmall.height; ++y) {
      for (int x = 0; x < kSmall.width; ++x) ASSERT_EQ(picture.at(x, y)[3], step) << x << " " << y;
    }
  }
}

TEST_P(GeometryTest, DepthOfATiltedPlane) {
  // The plane z = 2 + x. Column c looks along x = t z with t = 1.5 (2 (c + 0.5) / 120 - 1), so that
  // z = 2 / (1 - t): c = 20: t = -0.9875, z = 1.0063, 25.66 -> 26; c = 60: 51.65 -> 52;
  // c = 90: t = 0.7625, z = 8.4211, 214.7 -> 215.
  world_.add(quad(), unlit(kWhite), {0, 0, 2}, Vec3::Constant(100.0), turned(-45, Vec3::UnitY()));
  const Picture picture = draw({120, 80});
  EXPECT_EQ(picture.at(20, 7)[3], 26);
  EXPECT_EQ(picture.at(60, 40)[3], 52);
  EXPECT_EQ(picture.at(90, 71)[3], 215);
}

TEST_P(GeometryTest, CullingMaskLeavesOutLayersWithoutATrace) {
  world_.add(quad(), unlit(kGreen), {0, 0, 2}, Vec3::Constant(0.5));
  const Picture without = draw(kSmall);
  MeshRenderer& hidden = world_.add(quad(), unlit(kRed), {0, 0, 1}, Vec3::Constant(1.0));
  hidden.gameObject().setLayer(31);
  auto& sprites = world_.scene.create("Sparks").addComponent<Billboards>();
  sprites.gameObject().setLayer(31);
  sprites.billboards = {{{0, 0, 0.5}, 0.2}};
  world_.camera.culling_mask = 0x7FFFFFFFU;
  EXPECT_EQ(draw(kSmall).rgba, without.rgba);
  world_.camera.culling_mask = kAllLayers;
  EXPECT_EQ(draw(kSmall).at(30, 15), (Pixel{255, 0, 0, 26}));
  world_.camera.culling_mask = 0x80000000U;
  EXPECT_EQ(draw(kSmall).at(30, 15), (Pixel{255, 0, 0, 26}));
  hidden.gameObject().setLayer(30);
  sprites.gameObject().setLayer(0);
  EXPECT_EQ(draw(kSmall).at(30, 20), (Pixel{0, 0, 0, 255}));
}

TEST_P(GeometryTest, NearAndFarPlanesClip) {
  world_.camera.near_m = 0.5;
  world_.camera.far_m = 4.0;
  MeshRenderer& quad_renderer = world_.add(quad(), unlit(kWhite), {0, 0, 1}, Vec3::Constant(10.0));
  const auto centre = [&](double z) {
    quad_renderer.transform().setLocalPosition({0, 0, z});
    return draw(kSmall).at(30, 20);
  };
  EXPECT_EQ(centre(0.49), (Pixel{0, 0, 0, 255}));
  EXPECT_EQ(centre(0.51), (Pixel{255, 255, 255, 33}));   // 32.51
  EXPECT_EQ(centre(3.99), (Pixel{255, 255, 255, 254}));  // 254.36
  EXPECT_EQ(centre(4.01), (Pixel{0, 0, 0, 255}));
  EXPECT_EQ(centre(-1.0), (Pixel{0, 0, 0, 255}));
}

TEST_P(GeometryTest, BackFacesAreHiddenByDefault) {
  MeshRenderer& sheet = world_.add(quad(), unlit(kWhite), {0, 0, 1});
  const auto shown = [&] { return draw(kSmall).at(30, 20)[0] == 255; };
  EXPECT_TRUE(shown());
  sheet.transform().setLocalRotation(turned(180, Vec3::UnitY()));
  EXPECT_FALSE(shown());
  sheet.material.cull_back = false;
  EXPECT_TRUE(shown());
}

TEST_P(GeometryTest, MirroredObjectsKeepTheirFronts) {
  MeshRenderer& shape = world_.add(box(), unlit(kWhite), {0, 0, 3}, {-1, 1, 1});
  // The box's near face is 2.5 m away (63.75); without care its far face, 3.5 m away, would show.
  EXPECT_EQ(draw(kSmall).at(30, 20), (Pixel{255, 255, 255, 64}));
  shape.transform().setLocalScale({1, 1, 1});
  EXPECT_EQ(draw(kSmall).at(30, 20), (Pixel{255, 255, 255, 64}));
}

TEST_P(GeometryTest, HiddenThingsAreNotDrawn) {
  MeshRenderer& sheet = world_.add(quad(), unlit(kWhite), {0, 0, 1});
  const auto shown = [&] { return draw(kSmall).at(30, 20)[0] == 255; };
  sheet.visible = false;
  EXPECT_FALSE(shown());
  sheet.visible = true;
  EXPECT_TRUE(shown());
  sheet.setEnabled(false);
  EXPECT_FALSE(shown());
  sheet.setEnabled(true);
  sheet.gameObject().setActive(false);
  EXPECT_FALSE(shown());
  sheet.gameObject().setActive(true);
  sheet.transform().setLocalScale(0.0);
  EXPECT_FALSE(shown());
  sheet.transform().setLocalScale(1.0);
  sheet.mesh = nullptr;
  EXPECT_FALSE(shown());
}

// A square, and for an error of 0.1 m one that lies 1 m further to the right, to tell them apart.
MeshPtr squareWithStandIn() {
  Mesh coarse = *quad();
  for (Vertex& vertex : coarse.vertices) vertex.position.x() += 1.0F;
  Mesh fine = *quad();
  fine.coarser = {{share(std::move(coarse)), 0.1F}};
  return share(std::move(fine));
}

TEST_P(GeometryTest, StandInsAreDrawnWhereTheirErrorIsBelowHalfAPixel) {
  MeshRenderer& shape = world_.add(squareWithStandIn(), unlit(kWhite), {0, 0, 3.9});
  const auto fine = [&](ImageSize size) {
    return draw(size).at(size.width / 2, size.height / 2)[0] == 255;
  };
  // 40 rows over 2 * tan 45 deg: 20 pixels per metre at 1 m. 0.1 m * 20 / 3.9 = 0.51 pixels.
  EXPECT_TRUE(fine(kSmall));
  shape.transform().setLocalPosition({0, 0, 4.1});
  const Picture coarse = draw(kSmall);
  EXPECT_EQ(coarse.at(30, 20)[0], 0);
  EXPECT_EQ(coarse.at(35, 20)[0], 255);  // 1 m * 20 / 4.1 = 4.9 pixels to the right
  // Twice the pixels, a narrower view or a larger object: the error shows again.
  EXPECT_TRUE(fine({120, 80}));
  world_.camera.vertical_fov_deg = 60.0;
  EXPECT_TRUE(fine(kSmall));
  world_.camera.vertical_fov_deg = 90.0;
  shape.transform().setLocalScale({1.0, 2.0, 1.0});
  EXPECT_TRUE(fine(kSmall));
  shape.transform().setLocalScale(0.9);
  EXPECT_FALSE(fine(kSmall));
}

TEST_P(GeometryTest, ObjectsAtTheEdgeOfTheViewAreDrawn) {
  // Centres outside the view, a corner inside: must survive the collector's frustum test.
  world_.add(box(), unlit(kRed), {1.9, 0, 1.5}, Vec3::Constant(1.0));
  world_.add(sphere(24), unlit(kGreen), {0, 1.7, 1.0}, Vec3::Constant(1.0));
  const Picture picture = draw(kSmall);
  EXPECT_EQ(picture.at(59, 20)[0], 255);
  EXPECT_EQ(picture.at(30, 0)[1], 255);
}

}  // namespace
}  // namespace sim2vr::render::testing
