// SPDX-License-Identifier: Apache-2.0
// Colours of the procedural sky, on the CPU.
#pragma once

#include <cstdint>
#include <vector>

#include "sim2vr/core/math.hpp"
#include "sim2vr/render/material.hpp"

namespace sim2vr::render {

/// Skybox and the sun it is lit by.
struct SkySettings {
  float atmosphere_thickness = 1.0F;
  float exposure = 1.3F;
  Color sky_tint{0.5F, 0.5F, 0.5F, 1.0F};
  Color ground{0.369F, 0.349F, 0.341F, 1.0F};
  /// Unit vector towards the sun, world axes.
  Vec3 sun = Vec3::UnitY();

  bool operator==(const SkySettings&) const = default;
};

/// Linear light seen along a unit vector (world axes).
Eigen::Vector3f skyLight(const SkySettings& settings, const Vec3& ray);

struct DomeVertex {
  Eigen::Vector3f direction;
  Eigen::Vector3f light;
};

/// The sky at the corners of a dome, and three colours that stand for it in reflections.
struct SkyDome {
  std::vector<DomeVertex> vertices;
  std::vector<std::uint16_t> indices;
  Eigen::Vector3f high = Eigen::Vector3f::Zero();
  Eigen::Vector3f horizon = Eigen::Vector3f::Zero();
  Eigen::Vector3f ground = Eigen::Vector3f::Zero();
};

SkyDome makeSkyDome(const SkySettings& settings);

}  // namespace sim2vr::render
