#include "beats/shapes.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <utility>

namespace sim2vr::games::beats {
namespace {

using Vec3f = Eigen::Vector3f;
using render::Mesh;
using render::MeshPtr;

// Shares of the edge.
constexpr float kBar = 0.07F;
constexpr float kDotRadius = 0.22F;
// In front of the bars, so that neither hides the other.
constexpr float kMark_z = -0.5F - kBar / 4.0F;
constexpr int kStripes = 4;

void addTriangle(Mesh& mesh, const std::array<Vec3f, 3>& corners) {
  const Vec3f normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
  for (const Vec3f& corner : corners) {
    mesh.indices.push_back(static_cast<std::uint32_t>(mesh.vertices.size()));
    mesh.vertices.push_back({corner, normal});
  }
}

// A bar along `axis` as long as the edge, without its ends.
void addBar(Mesh& mesh, int axis, const Vec3f& center) {
  Vec3f size = Vec3f::Constant(kBar);
  size[axis] = 1.0F;
  const MeshPtr unit = render::box();
  for (std::size_t i = 0; i < unit->indices.size(); i += 3) {
    std::array<Vec3f, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      corners.at(k) = center + unit->vertices[unit->indices[i + k]].position.cwiseProduct(size);
    }
    if (std::abs(unit->vertices[unit->indices[i]].normal[axis]) < 0.5F) addTriangle(mesh, corners);
  }
}

Mesh frame(const std::string& name) {
  // Inside the unit cube, which is what is cut.
  constexpr float kMiddle = 0.5F - kBar / 2.0F;
  Mesh mesh;
  mesh.name = name;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float u : {-kMiddle, kMiddle}) {
      for (const float v : {-kMiddle, kMiddle}) {
        Vec3f center = Vec3f::Zero();
        center[(axis + 1) % 3] = u;
        center[(axis + 2) % 3] = v;
        addBar(mesh, axis, center);
      }
    }
  }
  return mesh;
}

}  // namespace

MeshPtr arrowBox() {
  static const MeshPtr mesh = [] {
    Mesh box = frame("arrow box");
    addTriangle(box, {Vec3f(-0.38F, 0.38F, kMark_z), Vec3f(0.38F, 0.38F, kMark_z),
                      Vec3f(0.0F, -0.28F, kMark_z)});
    return render::share(std::move(box));
  }();
  return mesh;
}

MeshPtr dotBox() {
  static const MeshPtr mesh = [] {
    Mesh box = frame("dot box");
    const MeshPtr disc = render::disc(8);
    const auto first = static_cast<std::uint32_t>(box.vertices.size());
    for (render::Vertex vertex : disc->vertices) {
      vertex.position = vertex.position * kDotRadius + Vec3f(0.0F, 0.0F, kMark_z);
      box.vertices.push_back(vertex);
    }
    for (const std::uint32_t index : disc->indices) box.indices.push_back(first + index);
    return render::share(std::move(box));
  }();
  return mesh;
}

MeshPtr star() {
  static const MeshPtr mesh = [] {
    const auto side = std::numbers::inv_sqrt3_v<float>;
    Mesh spikes;
    spikes.name = "mine";
    for (const float sign : {-1.0F, 1.0F}) {
      const std::array<Vec3f, 4> corners{Vec3f(1.0F, 1.0F, 1.0F), Vec3f(1.0F, -1.0F, -1.0F),
                                         Vec3f(-1.0F, 1.0F, -1.0F), Vec3f(-1.0F, -1.0F, 1.0F)};
      for (std::size_t left_out = 0; left_out < 4; ++left_out) {
        std::array<Vec3f, 3> face;
        for (std::size_t k = 0; k < 3; ++k) {
          face.at(k) = sign * side * corners.at((left_out + 1 + k) % 4);
        }
        const Vec3f middle = face[0] + face[1] + face[2];
        if ((face[1] - face[0]).cross(face[2] - face[0]).dot(middle) < 0.0F) {
          std::swap(face[1], face[2]);
        }
        addTriangle(spikes, face);
      }
    }
    return render::share(std::move(spikes));
  }();
  return mesh;
}

MeshPtr stripedBlock() {
  static const MeshPtr mesh = [] {
    Mesh block;
    block.name = "wall";
    // Along `along`, one above the other along `across`, on both sides of the block.
    const auto addStripes = [&block](int along, int across) {
      const int out = 3 - along - across;
      for (const float side : {-0.5F, 0.5F}) {
        for (int i = 0; i < kStripes; ++i) {
          const float low = (static_cast<float>(i) + 0.25F) / kStripes - 0.5F;
          std::array<Vec3f, 4> corners;
          for (std::size_t k = 0; k < 4; ++k) {
            Vec3f& corner = corners.at(k);
            corner[out] = side;
            corner[along] = k == 1 || k == 2 ? 0.5F : -0.5F;
            corner[across] = k >= 2 ? low + 0.5F / kStripes : low;
          }
          addTriangle(block, {corners[0], corners[1], corners[2]});
          addTriangle(block, {corners[0], corners[2], corners[3]});
        }
      }
    };
    addStripes(0, 1);  // front and back
    addStripes(2, 1);  // left and right
    addStripes(2, 0);  // top and bottom
    return render::share(std::move(block));
  }();
  return mesh;
}

}  // namespace sim2vr::games::beats
