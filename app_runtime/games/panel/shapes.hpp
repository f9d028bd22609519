// SPDX-License-Identifier: Apache-2.0
// Flat shapes and colours of a panel. In red light only what is to be operated is bright.
#pragma once

#include <string>

#include "sim2vr/render/components.hpp"
#include "sim2vr/scene/scene.hpp"

namespace sim2vr::games::panel {

inline constexpr render::Color kLit{1.0F, 0.15F, 0.10F, 1.0F};
inline constexpr render::Color kUnlit{0.12F, 0.35F, 0.55F, 1.0F};
inline constexpr render::Color kRail{0.08F, 0.12F, 0.18F, 1.0F};
inline constexpr render::Color kGoal{0.95F, 0.70F, 0.10F, 1.0F};
inline constexpr render::Color kPlate{0.05F, 0.08F, 0.11F, 1.0F};
inline constexpr render::Color kHit{0.10F, 0.85F, 0.30F, 1.0F};
inline constexpr render::Color kError{0.15F, 0.25F, 1.0F, 1.0F};

/// Adds an unlit shape below `parent`, `layer` steps of 1 mm in front of the panel.
render::MeshRenderer& addShape(scene::GameObject& parent, const std::string& name,
                               const render::MeshPtr& mesh, const Vec3& center_m,
                               const Vec3& size_m, const render::Color& color, int layer);

/// Moves it along the panel; its layer stays.
void moveShape(render::MeshRenderer& shape, const Vec3& center_m);

}  // namespace sim2vr::games::panel
