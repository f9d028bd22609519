// SPDX-License-Identifier: Apache-2.0
// What Whac-A-Mole shows: the spectators' camera, the player's headset, the burst of a hit.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/render/components.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "whacamole/looks.hpp"
#include "whacamole/round.hpp"
#include "whacamole_player.hpp"

namespace sim2vr::games::whacamole {
namespace {

const render::Camera& camera(const scene::Scene& scene, std::string_view path) {
  return *scene.find(path)->getComponent<render::Camera>();
}

/// A point as a camera sees it with an aspect of 4:3: 0, 0 is the middle, 1 the right or upper
/// edge.
Vec3 inPicture(const render::Camera& camera, const Vec3& world) {
  const Pose pose = camera.transform().pose();
  const Vec3 eye = pose.rotation.conjugate() * (world - pose.position);
  const double slope = std::tan(camera.vertical_fov_deg * std::numbers::pi / 360.0);
  return {eye.x() / eye.z() / slope * 0.75, eye.y() / eye.z() / slope, eye.z()};
}

TEST(Looks, SpectatorsSeeHeadHammerAndAreaOfEveryPlacement) {
  const Vec3 head(0.03, 1.22, -0.1);
  for (const std::string condition : {"low", "mid", "high"}) {
    WhacAMoleRound round(R"({"condition": ")" + condition + "\"}");
    round.head = head;
    round.frameWithMarker(head + Vec3(0.2, -0.15, 0.25));
    const scene::Scene& scene = round.harness.scene();
    const render::Camera& spectator = camera(scene, rl::kSpectatorCameraPath);
    std::vector<Vec3> points{head, round.round().hammer().markerPosition()};
    const scene::Transform& area = scene.find("Target Area")->transform();
    for (const double x : {-0.15, 0.15}) {
      for (const double y : {-0.15, 0.15}) points.push_back(area.transformPoint({x, y, 0.0}));
    }
    for (const Vec3& point : points) {
      const Vec3 seen = inPicture(spectator, point);
      EXPECT_LT(std::abs(seen.x()), 0.95) << condition;
      EXPECT_LT(std::abs(seen.y()), 0.95) << condition;
      EXPECT_GT(seen.z(), 0.5) << condition;
    }
    // From the player's side of the area, whose back is not drawn, and with the head beside it.
    const Vec3 stand = spectator.transform().position() - area.position();
    EXPECT_LT(stand.dot(area.forward()), -0.2) << condition;
    for (std::size_t i = 2; i < points.size(); ++i) {
      EXPECT_GT(inPicture(spectator, points[i]).x() - inPicture(spectator, head).x(), 0.2)
          << condition;
    }
  }
}

TEST(Looks, OnlySpectatorsSeeTheHeadset) {
  WhacAMoleRound round(R"({"condition": "mid"})");
  const scene::Scene& scene = round.harness.scene();
  const scene::GameObject& visor = *scene.find("XR Rig/Main Camera/Headset/Visor");
  EXPECT_FALSE(camera(scene, rl::kHeadCameraPath).sees(visor.layer()));
  EXPECT_FALSE(camera(scene, rl::kThirdPersonCameraPath).sees(visor.layer()));
  EXPECT_TRUE(camera(scene, rl::kSpectatorCameraPath).sees(visor.layer()));
  for (const auto path : {rl::kHeadCameraPath, rl::kThirdPersonCameraPath}) {
    EXPECT_TRUE(camera(scene, path).sees(0)) << path;
    EXPECT_TRUE(camera(scene, path).sees(kTargetLayer)) << path;
    EXPECT_TRUE(camera(scene, path).sees(kPlayerLayer)) << path;
  }
}

// The sparks start within 3 mm of the disc's centre, 1.0585 radii in front of the target's origin,
// and have flown 0.09 m/s * 20 ms + 0.81 m/s * 10 ms * (1 - exp(-2)) = 8.80 mm after 20 ms.
TEST(Looks, SparksFlyAwayFromThePlayer) {
  scene::Scene scene;
  scene::GameObject& target = scene.create("Target");
  const Quat tilt(Eigen::AngleAxisd(std::numbers::pi / 4.0, Vec3::UnitX()));
  target.transform().setPose({Vec3(1.0, 2.0, 3.0), tilt});
  target.transform().setLocalScale(0.025);
  target.addComponent<TargetLooks>().showBurst(0.02F);
  const auto& sparks = *target.getComponent<render::Billboards>();
  ASSERT_EQ(sparks.billboards.size(), 50U);
  const Vec3 disc = Vec3(1.0, 2.0, 3.0) + tilt * Vec3(0.0, 0.0, -1.0585 * 0.025);
  for (const render::Billboard& spark : sparks.billboards) {
    const Vec3 flown = spark.position_world - disc;
    EXPECT_GT(flown.dot(tilt * Vec3::UnitZ()), 0.0);
    EXPECT_GE(flown.norm(), 0.00880);
    EXPECT_LE(flown.norm(), 0.01181);
    // 7.5 to 30 mm, shrunk by 20 ms / 0.3 s.
    EXPECT_GE(spark.size_m, 0.0075 * 0.9333 - 1e-6);
    EXPECT_LE(spark.size_m, 0.0300 * 0.9334);
  }
}

float distanceToSegment(const Eigen::Vector3f& p, const Eigen::Vector3f& a,
                        const Eigen::Vector3f& b) {
  const Eigen::Vector3f along = b - a;
  const float t = std::clamp((p - a).dot(along) / along.squaredNorm(), 0.0F, 1.0F);
  return (p - a - t * along).norm();
}

float distanceToTriangle(const Eigen::Vector3f& p, const Eigen::Vector3f& a,
                         const Eigen::Vector3f& b, const Eigen::Vector3f& c) {
  const Eigen::Vector3f normal = (b - a).cross(c - a).normalized();
  const auto inside = [&](const Eigen::Vector3f& from, const Eigen::Vector3f& to) {
    return (to - from).cross(p - from).dot(normal) >= 0.0F;
  };
  if (inside(a, b) && inside(b, c) && inside(c, a)) return std::abs((p - a).dot(normal));
  return std::min(
      {distanceToSegment(p, a, b), distanceToSegment(p, b, c), distanceToSegment(p, c, a)});
}

/// Calls `visit` with the corners of each triangle.
template <class Visit>
void forEachTriangle(const render::Mesh& mesh, const Visit& visit) {
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
    const auto corner = [&](std::size_t k) -> const Eigen::Vector3f& {
      return mesh.vertices[mesh.indices[i + k]].position;
    };
    visit(corner(0), corner(1), corner(2));
  }
}

/// Largest distance of the points of one surface (a grid on each triangle) from the other surface.
float largestDistance(const render::Mesh& from, const render::Mesh& to) {
  constexpr int kSteps = 4;
  float largest = 0.0F;
  forEachTriangle(from, [&](const auto& a, const auto& b, const auto& c) {
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; i + j <= kSteps; ++j) {
        const Eigen::Vector3f p = a + (i * (b - a) + j * (c - a)) / static_cast<float>(kSteps);
        float nearest = 1e9F;
        forEachTriangle(to, [&](const auto& d, const auto& e, const auto& f) {
          nearest = std::min(nearest, distanceToTriangle(p, d, e, f));
        });
        largest = std::max(largest, nearest);
      }
    }
  });
  return largest;
}

TEST(Looks, CoarseShapesAreAsCloseAsTheySay) {
  WhacAMoleRound round(R"({"condition": "mid"})");
  round.waitFor(Target::State::kAlive);
  int checked = 0;
  round.harness.scene().forEach<render::MeshRenderer>([&](const render::MeshRenderer& shown) {
    for (const render::CoarserMesh& coarser : shown.mesh->coarser) {
      const float outside = largestDistance(*coarser.mesh, *shown.mesh);
      const float inside = largestDistance(*shown.mesh, *coarser.mesh);
      EXPECT_LE(std::max(outside, inside), coarser.error)
          << coarser.mesh->name << ": " << outside << ", " << inside;
      EXPECT_LT(coarser.mesh->triangleCount(), shown.mesh->triangleCount() * 4 / 5);
      ++checked;
    }
  });
  EXPECT_GE(checked, 10);  // target 2, rings 2, hammer head 2, handle 2, controller 2
}

}  // namespace
}  // namespace sim2vr::games::whacamole
