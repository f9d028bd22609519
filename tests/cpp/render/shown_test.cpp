// SPDX-License-Identifier: Apache-2.0
// What a scene shows, as plain data.
#include "sim2vr/render/shown.hpp"

#include <gtest/gtest.h>

#include <numbers>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/components.hpp"

namespace sim2vr::render {
namespace {

const Shown& at(const std::vector<Shown>& all, const std::string& path) {
  for (const Shown& each : all) {
    if (each.path == path) return each;
  }
  throw std::out_of_range(path);
}

TEST(Shown, TellsWhereEveryActiveObjectIsAndWhatItShows) {
  scene::Scene scene;
  scene::GameObject& table = scene.create("Table");
  table.transform().setLocalPosition({1.0, 2.0, 3.0});
  table.transform().setLocalRotation(
      Quat(Eigen::AngleAxisd(std::numbers::pi / 2.0, Vec3::UnitY())));
  scene::GameObject& cup = scene.create("Cup", &table);
  cup.setLayer(7);
  cup.transform().setLocalPosition({0.0, 0.0, 0.5});
  cup.transform().setLocalScale({0.1, 0.2, 0.3});
  Material glass;
  glass.albedo = {0.1F, 0.2F, 0.3F, 0.4F};
  glass.unlit = true;
  auto& renderer = cup.addComponent<MeshRenderer>(box(), glass);
  scene.create("Hidden").setActive(false);
  MeshNumbers meshes;

  std::vector<Shown> all = shownBy(scene, meshes);
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(at(all, "Table").mesh, -1);
  const Shown& shown = at(all, "Table/Cup");
  EXPECT_EQ(shown.object, cup.id());
  EXPECT_EQ(shown.layer, 7);
  EXPECT_EQ(&meshes.mesh(shown.mesh), box().get());
  // A quarter turn about y takes z to x.
  EXPECT_TRUE(shown.pose.position.isApprox(Vec3(1.5, 2.0, 3.0)));
  EXPECT_TRUE(shown.scale.isApprox(Vec3(0.1, 0.2, 0.3)));
  EXPECT_EQ(shown.color, (Color{0.1F, 0.2F, 0.3F, 1.0F})) << "an opaque surface";
  EXPECT_TRUE(shown.unlit);

  renderer.material.blend = Material::Blend::alpha;
  EXPECT_EQ(at(shownBy(scene, meshes), "Table/Cup").color.a, 0.4F);
  renderer.visible = false;
  EXPECT_EQ(at(shownBy(scene, meshes), "Table/Cup").mesh, -1);
}

TEST(Shown, ParticlesAreBallsOfTheSameWidthAndMeshesKeepTheirNumbers) {
  scene::Scene scene;
  auto& sparks = scene.create("Sparks").addComponent<Billboards>();
  auto& ring = scene.create("Ring").addComponent<MeshRenderer>(disc());
  MeshNumbers meshes;
  EXPECT_THROW(meshes.mesh(0), InvalidArgument);
  EXPECT_EQ(at(shownBy(scene, meshes), "Ring").mesh, 0);

  sparks.color = {1.0F, 0.5F, 0.0F, 0.9F};
  sparks.billboards = {{Vec3(1.0, 0.0, 0.0), 0.04}, {Vec3(2.0, 0.0, 0.0), 0.02}};
  ring.mesh = nullptr;
  const std::vector<Shown> all = shownBy(scene, meshes);
  ASSERT_EQ(all.size(), 4U) << "the object itself, and each particle";
  EXPECT_EQ(all[1].object, all[0].object);
  EXPECT_EQ(all[1].mesh, 1);
  EXPECT_EQ(all[1].color, sparks.color);
  EXPECT_TRUE(all[1].pose.position.isApprox(Vec3(1.0, 0.0, 0.0)));
  EXPECT_TRUE(all[2].scale.isApprox(Vec3::Constant(0.01))) << "a ball's radius";
  ring.mesh = disc();
  EXPECT_EQ(at(shownBy(scene, meshes), "Ring").mesh, 0);
  EXPECT_THROW(meshes.mesh(2), InvalidArgument);
}

}  // namespace
}  // namespace sim2vr::render
