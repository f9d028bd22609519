// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

#include "sim2vr/scene/component.hpp"

namespace sim2vr::physics {

/// Marks an object (with the colliders below it) as a body: a trigger event needs one body at
/// least. Only kinematic bodies exist so far: the Transform moves them, nothing pushes them.
class Rigidbody final : public scene::Component {
 public:
  /// Throws InvalidArgument ("rigidbody.is_kinematic") for a dynamic body.
  explicit Rigidbody(bool is_kinematic = true);

  std::string_view typeName() const override { return "Rigidbody"; }
};

}  // namespace sim2vr::physics
