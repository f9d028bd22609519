// SPDX-License-Identifier: Apache-2.0
// Which colours things have: encoding, lights, blending, sky. Hand-derived values.
#include "demo_scene.hpp"
#include "picture.hpp"

namespace sim2vr::render::testing {
namespace {

using LightTest = GlTest;
SIM2VR_FOR_EACH_GL(LightTest);

constexpr ImageSize kView{60, 40};

Color srgb8(int r, int g, int b) {
  return {static_cast<float>(r) / 255.0F, static_cast<float>(g) / 255.0F,
          static_cast<float>(b) / 255.0F, 1.0F};
}

TEST(ColorTest, EncodingIsIec61966) {
  EXPECT_NEAR(linearFromSrgb(0.5F), 0.21404F, 1e-5);
  EXPECT_NEAR(srgbFromLinear(0.5F), 0.73536F, 1e-5);
  EXPECT_NEAR(linearFromSrgb(0.04F), 0.04F / 12.92F, 1e-7);
  for (int i = 0; i < 256; ++i) {
    const float value = static_cast<float>(i) / 255.0F;
    EXPECT_NEAR(srgbFromLinear(linearFromSrgb(value)), value, 1e-5);
  }
}

TEST(ColorTest, LerpClampsAndMixesEncodedValues) {
  EXPECT_EQ(lerp(kGreen, kRed, 0.25F), (Color{0.25F, 0.75F, 0, 1}));
  EXPECT_EQ(lerp(kGreen, kRed, -1.0F), kGreen);
  EXPECT_EQ(lerp(kGreen, kRed, 2.0F), kRed);
}

TEST_P(LightTest, UnlitColourComesBackAsGiven) {
  MeshRenderer& sheet = world_.add(quad(), unlit(kWhite), {0, 0, 1}, Vec3::Constant(10.0));
  for (const Pixel& wanted :
       {Pixel{200, 100, 50, 26}, Pixel{1, 128, 254, 26}, Pixel{3, 12, 77, 26}}) {
    sheet.material.albedo = srgb8(wanted[0], wanted[1], wanted[2]);
    EXPECT_LE(difference(draw(kView).at(30, 20), wanted), 1);
  }
}

TEST_P(LightTest, Lambert) {
  world_.add(quad(), matt({0.5F, 0.5F, 0.5F, 1}), {0, 0, 1}, Vec3::Constant(10.0));
  world_.addLight({std::sqrt(0.75), 0, 0.5});  // 60 degrees from the normal
  // 0.21404 * 0.96 * 0.5 = 0.10274 -> sRGB 0.3538 -> 90.2
  EXPECT_NEAR(draw(kView).at(30, 20)[0], 90, 1);
  world_.addLight({0, 0.6, 0.8},
                  0.5F);  // + 0.21404 * 0.96 * 0.8 * 0.5 = 0.18493 -> 0.4675 -> 119.2
  EXPECT_NEAR(draw(kView).at(30, 20)[0], 119, 1);
  world_.addLight({0, 0, -1}, 0.9F);  // from behind: nothing
  EXPECT_NEAR(draw(kView).at(30, 20)[0], 119, 1);
}

TEST_P(LightTest, SheetsAreLitOnTheSideThatIsSeen) {
  Material material = matt({0.5F, 0.5F, 0.5F, 1});
  material.cull_back = false;
  world_.add(quad(), material, {0, 0, 1}, Vec3::Constant(10.0), turned(180, Vec3::UnitY()));
  world_.addLight({std::sqrt(0.75), 0, 0.5});
  EXPECT_NEAR(draw(kView).at(30, 20)[0], 90, 1);
}

TEST_P(LightTest, NonUniformScaleKeepsNormalsRight) {
  // A box turned by 45 degrees about y and stretched along its own x: the face's normal stays at
  // 45 degrees, so that light along +z gives 0.21404 * 0.96 * 0.70711 = 0.14530 -> 0.4176 -> 106.5.
  world_.add(box(), matt({0.5F, 0.5F, 0.5F, 1}), {0, 0, 4}, {4, 1, 1}, turned(45, Vec3::UnitY()));
  world_.addLight({0, 0, 1});
  EXPECT_NEAR(draw(kView).at(30, 20)[0], 106.5, 1.5);
}

TEST_P(LightTest, HighlightOfABlackSurfaceSeenAlongTheLight) {
  Material material;
  material.albedo = {0, 0, 0, 1};
  material.sky_reflections = false;
  world_.add(quad(), material, {0, 0, 5}, Vec3::Constant(0.5));
  world_.addLight({0, 0, 1});
  // Smoothness 0.5: alpha = 0.25; GGX at its peak 1/alpha^2, visibility 1/4, Fresnel 0.04:
  // 0.16 -> sRGB 0.4366 -> 111.3
  EXPECT_NEAR(draw({61, 41}).at(30, 20)[0], 111, 2);
}

TEST_P(LightTest, MetalShowsLessDiffuseLight) {
  Material material = matt(kWhite);
  material.metallic = 0.5F;  // gamma-encoded: 0.21404
  world_.add(quad(), material, {0, 0, 1}, Vec3::Constant(10.0));
  world_.addLight({0, 0, 1});
  // 0.96 * 0.78596 = 0.75452 -> 0.8831 -> 225.2
  EXPECT_NEAR(draw(kView).at(30, 20)[0], 225, 1);
}

TEST_P(LightTest, SkyReflectionsNeedASky) {
  Material material = matt({0, 0, 0, 1});
  material.smoothness = 1.0F;
  material.sky_reflections = true;
  world_.add(quad(), material, {0, 0, 1}, Vec3::Constant(10.0));
  EXPECT_EQ(draw(kView).at(30, 10)[2], 0);
  world_.scene.create("Sky").addComponent<Skybox>();
  EXPECT_GT(draw(kView).at(30, 10)[2], 20);
}

TEST_P(LightTest, AlphaItemsBlendInLinearLightAndLeaveTheDepthAlone) {
  Material glass = unlit({1, 1, 1, 0.5F});
  glass.blend = Material::Blend::alpha;
  world_.add(quad(), glass, {0, 0, 2}, Vec3::Constant(10.0));
  world_.add(quad(), unlit(srgb8(0, 0, 0)), {0, 0, 4}, Vec3::Constant(20.0));
  // 0.5 -> sRGB 0.7354 -> 187.5; depth 0.4 * 255 = 102
  const Pixel pixel = draw(kView).at(30, 20);
  EXPECT_NEAR(pixel[0], 187.5, 1);
  EXPECT_EQ(pixel[3], 102);
}

TEST_P(LightTest, AlphaItemsBehindOpaqueOnesAreHidden) {
  Material glass = unlit({1, 1, 1, 0.5F});
  glass.blend = Material::Blend::alpha;
  world_.add(quad(), glass, {0, 0, 4}, Vec3::Constant(20.0));
  world_.add(quad(), unlit(kGreen), {0, 0, 2}, Vec3::Constant(10.0));
  EXPECT_EQ(draw(kView).at(30, 20), (Pixel{0, 255, 0, 51}));
}

TEST_P(LightTest, AlphaItemsAreDrawnFarToNear) {
  const auto glass = [](Color color) {
    Material material = unlit(color);
    material.blend = Material::Blend::alpha;
    return material;
  };
  // Near red over far green: 0.75 red, 0.25 * 0.75 green, whichever was made first.
  for (const bool near_first : {true, false}) {
    World world;
    for (const bool near_one : {near_first, !near_first}) {
      world.add(quad(), glass(near_one ? Color{1, 0, 0, 0.75F} : Color{0, 1, 0, 0.75F}),
                {0, 0, near_one ? 2.0 : 3.0}, Vec3::Constant(20.0));
    }
    const Pixel pixel = testing::draw(*renderer_, world.scene, world.camera, kView).at(30, 20);
    EXPECT_NEAR(pixel[0], 225, 1);  // 0.75 -> 0.8808 -> 224.6
    EXPECT_NEAR(pixel[1], 120, 1);  // 0.1875 -> 0.4706 -> 120.0
    EXPECT_EQ(pixel[3], 255);
  }
}

TEST_P(LightTest, BillboardsFaceTheCameraAndHaveNoDepth) {
  auto& sprites = world_.scene.create("Burst").addComponent<Billboards>();
  sprites.color = kGreen;
  sprites.billboards = {{{0, 0, 1}, 0.2}, {{0.5, 0, 1}, 0.0}};
  // 0.2 m at 1 m: 4 of 40 rows and columns around the centre.
  for (const double roll : {0.0, 45.0}) {
    world_.camera.transform().setLocalRotation(turned(roll, Vec3::UnitZ()));
    const Picture picture = draw(kView);
    EXPECT_EQ(picture.at(28, 18), (Pixel{0, 255, 0, 255})) << roll;
    EXPECT_EQ(picture.at(31, 21), (Pixel{0, 255, 0, 255})) << roll;
    EXPECT_EQ(picture.at(27, 18), (Pixel{0, 0, 0, 255})) << roll;
    EXPECT_EQ(picture.at(40, 20), (Pixel{0, 0, 0, 255})) << roll;
  }
}

TEST_P(LightTest, BackgroundWithoutSky) {
  world_.camera.background = srgb8(10, 200, 99);
  EXPECT_LE(difference(draw(kView).at(3, 3), Pixel{10, 200, 99, 255}), 1);
}

/// A point of the published picture of the Whac-A-Mole study (456 x 257 pixels) and its colour.
struct Sample {
  int x, y;
  Pixel color;
};

TEST_P(LightTest, SkyLooksAsInThePublishedPicture) {
  scene::Scene scene;
  demo::addSurroundings(scene);
  const Picture picture =
      testing::draw(*renderer_, scene, demo::addFigureCamera(scene), {456, 257});
  // From the top over the horizon (row 150) to the ground, at the left and the right edge.
  // Tolerance: 6 levels; the picture itself was scaled and compressed.
  const std::array<Sample, 18> samples = {{
      {5, 2, {118, 139, 155, 0}},
      {5, 30, {127, 147, 163, 0}},
      {5, 60, {141, 159, 172, 0}},
      {5, 90, {157, 173, 177, 0}},
      {5, 120, {182, 191, 172, 0}},
      {5, 150, {214, 205, 152, 0}},
      {5, 154, {209, 198, 151, 0}},
      {5, 180, {204, 193, 170, 0}},
      {5, 220, {202, 189, 164, 0}},
      {415, 2, {135, 159, 179, 0}},
      {415, 30, {149, 171, 189, 0}},
      {415, 60, {167, 187, 199, 0}},
      {415, 90, {188, 206, 208, 0}},
      {415, 120, {216, 222, 199, 0}},
      {415, 150, {250, 239, 176, 0}},
      {415, 154, {225, 213, 161, 0}},
      {415, 180, {204, 193, 170, 0}},
      {415, 220, {202, 189, 164, 0}},
  }};
  for (const Sample& sample : samples) {
    const Pixel pixel = picture.at(sample.x, sample.y);
    EXPECT_LE(difference(pixel, sample.color, 3), 6)
        << "at " << sample.x << ", " << sample.y << ": " << pixel[0] << " " << pixel[1] << " "
        << pixel[2];
    EXPECT_EQ(pixel[3], 255);
  }
}

TEST_P(LightTest, ObjectsLookAsInThePublishedPicture) {
  scene::Scene scene;
  demo::addSurroundings(scene);
  demo::addObjects(scene);
  const Picture picture =
      testing::draw(*renderer_, scene, demo::addFigureCamera(scene), {456, 257});
  // Tolerance: 12 levels (a target's colour changes by 6 levels per frame).
  const std::array<Sample, 6> samples = {{
      {181, 135, {22, 232, 15, 0}},    // fresh target
      {181, 230, {105, 124, 12, 0}},   // middle-aged target
      {320, 115, {222, 19, 16, 0}},    // old target
      {146, 88, {68, 33, 6, 0}},       // hammer's head
      {140, 158, {35, 14, 10, 0}},     // its handle
      {300, 200, {182, 207, 148, 0}},  // ground through the target area
  }};
  for (const Sample& sample : samples) {
    const Pixel pixel = picture.at(sample.x, sample.y);
    EXPECT_LE(difference(pixel, sample.color, 3), 12)
        << "at " << sample.x << ", " << sample.y << ": " << pixel[0] << " " << pixel[1] << " "
        << pixel[2];
  }
}

TEST_P(LightTest, SkyFollowsItsSettingsAndTheSun) {
  auto& sky = world_.scene.create("Sky").addComponent<Skybox>();
  DirectionalLight& sun = world_.addLight({0, -1, 0});
  const Pixel noon = draw(kView).at(30, 5);
  EXPECT_GT(noon[2], noon[0]);  // a blue sky
  sky.exposure = 0.3F;
  EXPECT_LT(draw(kView).at(30, 5)[2], noon[2]);
  sky.exposure = 1.3F;
  EXPECT_EQ(draw(kView).at(30, 5), noon);
  sun.transform().setLocalRotation(turned(-10, Vec3::UnitX()));  // sun below the horizon
  EXPECT_LT(draw(kView).at(30, 5)[2], noon[2]);
  sky.setEnabled(false);
  EXPECT_EQ(draw(kView).at(30, 5), (Pixel{0, 0, 0, 255}));
}

}  // namespace
}  // namespace sim2vr::render::testing
