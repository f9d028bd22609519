// SPDX-License-Identifier: Apache-2.0
// Meshes, OBJ files, PNG files and the components' saved state.
#include "sim2vr/render/mesh.hpp"
#include "own_folder.hpp"

#include <gtest/gtest.h>
#include <png.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/render/image_io.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::render {
namespace {

constexpr double kPi = std::numbers::pi;

template <class Call>
std::string messageOf(Call call) {
  try {
    call();
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "nothing was thrown";
}

struct Measures {
  double area = 0;
  /// Enclosed by the fronts; meaningful for closed meshes.
  double volume = 0;
  /// Smallest cosine between a triangle's front and its corners' normals.
  double agreement = 1;
};

Measures measure(const Mesh& mesh) {
  Measures sum;
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
    std::array<Vec3, 3> p, n;
    for (std::size_t k = 0; k < 3; ++k) {
      p[k] = mesh.vertices[mesh.indices[i + k]].position.cast<double>();
      n[k] = mesh.vertices[mesh.indices[i + k]].normal.cast<double>();
      EXPECT_NEAR(n[k].norm(), 1.0, 1e-5) << mesh.name;
    }
    const Vec3 across = (p[1] - p[0]).cross(p[2] - p[0]);
    sum.area += across.norm() / 2;
    sum.volume += p[0].dot(p[1].cross(p[2])) / 6;
    for (const Vec3& normal : n) {
      sum.agreement = std::min(sum.agreement, across.normalized().dot(normal));
    }
  }
  return sum;
}

TEST(MeshTest, PrimitivesHaveTheirSizesAndFaceOutwards) {
  const Measures cube = measure(*box());
  EXPECT_NEAR(cube.area, 6.0, 1e-6);
  EXPECT_NEAR(cube.volume, 1.0, 1e-6);
  EXPECT_NEAR(cube.agreement, 1.0, 1e-6);
  const Measures ball = measure(*sphere(64));
  EXPECT_NEAR(ball.volume, 4 * kPi / 3, 0.02);
  EXPECT_GT(ball.agreement, 0.95);
  const Measures drum = measure(*cylinder(128));
  EXPECT_NEAR(drum.volume, kPi, 0.01);
  EXPECT_NEAR(drum.area, 4 * kPi, 0.02);
  const Measures pill = measure(*capsule(0.5, 3.0, 64));
  EXPECT_NEAR(pill.volume, kPi * 0.25 * 2 + 4 * kPi / 3 * 0.125, 0.02);
}

TEST(MeshTest, FlatShapesFaceMinusZ) {
  for (const MeshPtr& mesh : {quad(), disc(), annulus(0.5, 1.0)}) {
    EXPECT_NEAR(measure(*mesh).agreement, 1.0, 1e-6) << mesh->name;
    for (const Vertex& vertex : mesh->vertices) {
      EXPECT_EQ(vertex.position.z(), 0.0F);
      EXPECT_EQ(vertex.normal, -Eigen::Vector3f::UnitZ());
    }
  }
  EXPECT_NEAR(measure(*quad()).area, 1.0, 1e-6);
  EXPECT_NEAR(measure(*disc(128)).area, kPi, 0.005);
  EXPECT_NEAR(measure(*annulus(0.5, 1.0, 128)).area, 0.75 * kPi, 0.005);
}

TEST(MeshTest, HemisphereOpensTowardsMinusZ) {
  const MeshPtr mesh = hemisphere(32);
  EXPECT_NEAR(measure(*mesh).area, 2 * kPi, 0.1);
  float lowest = 1, highest = -1;
  for (const Vertex& vertex : mesh->vertices) {
    lowest = std::min(lowest, vertex.position.z());
    highest = std::max(highest, vertex.position.z());
  }
  EXPECT_EQ(lowest, 0.0F);
  EXPECT_EQ(highest, 1.0F);
}

TEST(MeshTest, TriangleCountsStaySmall) {
  EXPECT_EQ(box()->triangleCount(), 12U);
  EXPECT_EQ(disc(20)->triangleCount(), 18U);
  EXPECT_EQ(annulus(0.5, 1.0, 20)->triangleCount(), 40U);
  EXPECT_EQ(hemisphere(20)->triangleCount(), 180U);
  EXPECT_EQ(sphere(16)->triangleCount(), 224U);
}

TEST(MeshTest, EqualArgumentsShareOneMesh) {
  EXPECT_EQ(sphere(12), sphere(12));
  EXPECT_NE(sphere(12), sphere(13));
  EXPECT_EQ(capsule(0.1, 0.3, 8), capsule(0.1, 0.3, 8));
}

TEST(MeshTest, LatheShadesSmoothlyExceptAtEdges) {
  // A closed can: three faces at right angles, so every ring of corners is doubled.
  const std::array can = {LathePoint{0, 0}, LathePoint{1, 0}, LathePoint{1, 2}, LathePoint{0, 2}};
  const Measures measures = measure(*lathe(can, 64));
  EXPECT_NEAR(measures.volume, 2 * kPi, 0.05);
  EXPECT_GT(measures.agreement, 0.99);
  // A barrel that bends by 20 degrees: one row of corners in the middle, normal straight outwards.
  const double slope = std::tan(10 * kPi / 180);
  const std::array barrel = {LathePoint{1, -1}, LathePoint{1 + slope, 0}, LathePoint{1, 1}};
  const MeshPtr mesh = lathe(barrel, 8);
  EXPECT_EQ(mesh->vertices.size(), 3U * 9U);
  EXPECT_NEAR(mesh->vertices[9].normal.y(), 0.0F, 1e-6);
}

// A square of area 2 r^2 against a disc of area pi: r = sqrt(pi / 2).
TEST(MeshTest, EqualAreaRadius) {
  EXPECT_EQ(equalAreaRadius(8, 8), 1.0);
  EXPECT_NEAR(equalAreaRadius(4, 100000), std::sqrt(kPi / 2.0), 1e-6);
  EXPECT_NEAR(measure(*disc(6)).area * std::pow(equalAreaRadius(6, 16), 2), measure(*disc(16)).area,
              1e-6);
}

TEST(MeshTest, StripIsAsWideAsAskedAndTurnsCorners) {
  const std::array points = {Vec3(-1, 0, 0), Vec3(0, 0, 1), Vec3(1, 0, 0)};
  const MeshPtr mesh = strip(points, 0.2);
  EXPECT_EQ(mesh->triangleCount(), 4U);
  const Measures measures = measure(*mesh);
  EXPECT_NEAR(measures.agreement, 1.0, 1e-6);
  EXPECT_NEAR(measures.area, 2 * std::sqrt(2.0) * 0.2, 1e-6);
  EXPECT_EQ(mesh->vertices[0].normal, Eigen::Vector3f::UnitY());
}

TEST(MeshTest, RefusesImpossibleShapes) {
  EXPECT_EQ(messageOf([] { sphere(2); }), "segments: got 2, expected a number from 3 to 512");
  EXPECT_EQ(messageOf([] { capsule(1.0, 1.5); }),
            "height_m: got 1.5, expected at least twice the radius 1");
  EXPECT_EQ(messageOf([] { annulus(1.0, 1.0); }),
            "inner_radius_m: got 1, expected at least 0 and less than the outer radius 1");
  EXPECT_EQ(messageOf([] { lathe({}, 8); }), "profile: got 0 points, expected at least 2 points");
  EXPECT_EQ(messageOf([] { strip({}, 1.0); }), "points: got 0 points, expected at least 2 points");
  EXPECT_EQ(messageOf([] { share(Mesh{{}, {}, "nothing"}); }),
            "mesh 'nothing' indices: got 0, expected a positive multiple of three");
  EXPECT_EQ(messageOf([] {
              Mesh mesh = *quad();
              mesh.name = "sheet";
              mesh.coarser = {{quad(), 0.5F}, {quad(), 0.5F}};
              share(std::move(mesh));
            }),
            "mesh 'sheet' coarser: got an error of 0.5 after 0.5, expected meshes with growing "
            "errors above 0");
  EXPECT_EQ(messageOf([] { share(Mesh{{Vertex{}}, {0, 0, 1}, "far"}); }),
            "mesh 'far' index: got 1, expected less than 1 (the vertex count)");
}

class FileTest : public ::testing::Test {
 protected:
  const sim2vr::testing::OwnFolder folder_;
  const std::filesystem::path path_ = folder_ / "picture.png";
};

TEST_F(FileTest, PngComesBackAsWritten) {
  for (const int channels : {1, 3, 4}) {
    std::vector<std::uint8_t> pixels;
    for (int i = 0; i < 3 * 2 * channels; ++i) pixels.push_back(static_cast<std::uint8_t>(i * 9));
    writePng(path_, {3, 2}, pixels, channels);
    png_image image{};
    image.version = PNG_IMAGE_VERSION;
    ASSERT_NE(png_image_begin_read_from_file(&image, path_.c_str()), 0);
    EXPECT_EQ(image.width, 3U);
    EXPECT_EQ(image.height, 2U);
    std::vector<std::uint8_t> read(PNG_IMAGE_SIZE(image));
    ASSERT_NE(png_image_finish_read(&image, nullptr, read.data(), 0, nullptr), 0);
    EXPECT_EQ(read, pixels);
  }
}

TEST(Png, InMemoryComesBackAsEncoded) {
  std::vector<std::uint8_t> pixels;
  for (int i = 0; i < 5 * 3 * 4; ++i) pixels.push_back(static_cast<std::uint8_t>(i * 7));
  const std::string png = encodePng({5, 3}, pixels);
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  ASSERT_NE(png_image_begin_read_from_memory(&image, png.data(), png.size()), 0);
  EXPECT_EQ(image.format, static_cast<png_uint_32>(PNG_FORMAT_RGBA));
  std::vector<std::uint8_t> read(PNG_IMAGE_SIZE(image));
  ASSERT_NE(png_image_finish_read(&image, nullptr, read.data(), 0, nullptr), 0);
  EXPECT_EQ(read, pixels);
  EXPECT_THROW(encodePng({5, 4}, pixels), InvalidArgument);
}

TEST_F(FileTest, PngErrors) {
  const std::vector<std::uint8_t> pixels(12);
  EXPECT_EQ(messageOf([&] { writePng(path_, {2, 2}, pixels, 2); }),
            "channels: got 2, expected 1, 3 or 4");
  EXPECT_EQ(messageOf([&] { writePng(path_, {2, 2}, pixels, 4); }),
            "pixels: got 12 bytes, expected 16 bytes (height x width x channels)");
  EXPECT_EQ(messageOf([&] { writePng(path_, {0, 2}, pixels, 3); }),
            "image size: got 0 x 2, expected width and height from 1 to 8192 pixels");
  EXPECT_THROW(writePng("no/such/folder/x.png", {2, 2}, pixels, 3), EngineError);
}

TEST(ComponentTest, FieldsSurviveSavingAndLoading) {
  scene::Scene scene;
  scene::GameObject& object = scene.create("Thing");
  auto& shown = object.addComponent<MeshRenderer>(box());
  auto& light = object.addComponent<DirectionalLight>();
  auto& camera = object.addComponent<Camera>();
  auto& sprites = object.addComponent<Billboards>();
  auto& sky = object.addComponent<Skybox>();
  shown.material.albedo = {0.1F, 0.2F, 0.3F, 0.4F};
  shown.material.blend = Material::Blend::alpha;
  shown.visible = false;
  light.intensity = 0.25F;
  camera.far_m = 3.0;
  sprites.billboards = {{{1, 2, 3}, 0.5}};
  sky.exposure = 0.83F;
  Archive saved = Archive::saver();
  scene.fields(saved);

  const Material before = shown.material;
  shown.material = Material{};
  shown.visible = true;
  light.intensity = 9.0F;
  camera.far_m = 9.0;
  sprites.billboards.clear();
  sky.exposure = 9.0F;
  Archive loaded = Archive::loader(saved.bytes());
  scene.fields(loaded);
  EXPECT_EQ(shown.material, before);
  EXPECT_FALSE(shown.visible);
  EXPECT_EQ(light.intensity, 0.25F);
  EXPECT_EQ(camera.far_m, 3.0);
  ASSERT_EQ(sprites.billboards.size(), 1U);
  EXPECT_EQ(sprites.billboards[0].position_world, Vec3(1, 2, 3));
  EXPECT_EQ(sky.exposure, 0.83F);
}

}  // namespace
}  // namespace sim2vr::render
