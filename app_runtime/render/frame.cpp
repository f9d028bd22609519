// SPDX-License-Identifier: Apache-2.0
#include "frame.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numbers>
#include <tuple>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {
namespace {

constexpr std::size_t kLogSize = 4096;

GLuint compile(const gl::Functions& gl, GLenum stage, const std::string& file,
               const std::string& variant) {
  const std::string define = variant.empty() ? "" : fmt::format("#define {} 1\n", variant);
  const std::string text =
      "#version 420 core\n" + define + shaderText("frame.glsl") + "#line 1\n" + shaderText(file);
  const GLuint shader = gl.CreateShader(stage);
  const char* source = text.c_str();
  gl.ShaderSource(shader, 1, &source, nullptr);
  gl.CompileShader(shader);
  GLint ok = 0;
  gl.GetShaderiv(shader, GL_COMPILE_STATUS, &ok);
  if (ok == GL_TRUE) return shader;
  std::array<char, kLogSize> log{};
  gl.GetShaderInfoLog(shader, static_cast<GLsizei>(log.size()), nullptr, log.data());
  gl.DeleteShader(shader);
  throw RenderError(fmt::format("shader {} {} does not compile: {}", file, variant, log.data()));
}

constexpr std::uint64_t kFramesBetweenSweeps = 512;

std::array<float, 3> floats(const Eigen::Vector3f& v) { return {v.x(), v.y(), v.z()}; }

/// Part of the light that paint mirrors at normal incidence (Unity's dielectric specular colour).
constexpr float kDielectricSpecular = 0.04F;

/// Errors of a mesh below this do not count: without anti-aliasing a pixel shows what its middle
/// hits, so that outlines are up to half a pixel off anyway.
constexpr float kInvisible_px = 0.5F;

Vec4f vec4(const Eigen::Vector3f& v, float w = 0.0F) { return {v.x(), v.y(), v.z(), w}; }

void checkCamera(const Camera& camera) {
  const auto text = [](double value) { return fmt::format("{}", value); };
  if (!(camera.vertical_fov_deg > 0.0 && camera.vertical_fov_deg < 180.0)) {
    throw InvalidArgument("camera.vertical_fov_deg", text(camera.vertical_fov_deg),
                          "an angle between 0 and 180 degrees");
  }
  if (!(camera.near_m > 0.0 && std::isfinite(camera.near_m))) {
    throw InvalidArgument("camera.near_m", text(camera.near_m), "a finite distance above 0");
  }
  if (!(camera.far_m > camera.near_m && std::isfinite(camera.far_m))) {
    throw InvalidArgument("camera.far_m", text(camera.far_m),
                          fmt::format("a finite distance above near_m = {}", camera.near_m));
  }
  if (!camera.transform().pose().isFinite()) {
    throw InvalidArgument("camera pose", "a value that is not finite", "a finite pose");
  }
}

/// Slopes: half of the picture's width and height, and where its middle is.
struct Frustum {
  double half_width, half_height, middle_x, middle_y;
};

Frustum frustumOf(double vertical_fov_deg, ImageSize size) {
  const double tan_y = std::tan(vertical_fov_deg * std::numbers::pi / 360.0);
  return {tan_y * size.width / size.height, tan_y, 0.0, 0.0};
}

Frustum frustumOf(const EyeView& eye) {
  if (!(eye.right > eye.left && eye.up > eye.down)) {
    throw InvalidArgument(
        "eye",
        fmt::format("slopes from {} to {} and {} to {}", eye.left, eye.right, eye.down, eye.up),
        "left below right and down below up");
  }
  return {0.5 * (eye.right - eye.left), 0.5 * (eye.up - eye.down), 0.5 * (eye.right + eye.left),
          0.5 * (eye.up + eye.down)};
}

Shading shadingOf(const Material& material) {
  if (material.unlit) return Shading::unlit;
  return material.specular_highlights ? Shading::specular : Shading::diffuse;
}

/// Unity's metallic workflow: metal trades diffuse light for coloured reflections. The slider value
/// is gamma-encoded, as Unity's [Gamma] property.
void setSurface(const Material& material, bool opaque, InstanceData& instance) {
  const Eigen::Vector3f albedo = linearRgb(material.albedo);
  const float opacity = opaque ? -1.0F : material.albedo.a;
  if (material.unlit) {
    instance.diffuse = vec4(albedo, opacity);
    instance.specular = {};
    return;
  }
  const float metal = linearFromSrgb(material.metallic);
  const Eigen::Vector3f dielectric = Eigen::Vector3f::Constant(kDielectricSpecular);
  instance.diffuse = vec4(albedo * ((1.0F - kDielectricSpecular) * (1.0F - metal)), opacity);
  instance.specular = vec4(dielectric + (albedo - dielectric) * metal, 1.0F - material.smoothness);
}

}  // namespace

std::string shaderText(std::string_view file_name) {
  if (const char* folder = std::getenv("SIM2VR_SHADER_DIR")) {
    std::ifstream file(std::filesystem::path(folder) / file_name);
    if (file) return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }
  const auto found = embeddedShaders().find(std::string(file_name));
  if (found == embeddedShaders().end()) {
    throw RenderError(fmt::format("there is no shader file '{}'", file_name));
  }
  return found->second;
}

GLuint buildProgram(const gl::Functions& gl, const std::string& name, const std::string& variant) {
  const GLuint vertex = compile(gl, GL_VERTEX_SHADER, name + ".vert", variant);
  const GLuint fragment = compile(gl, GL_FRAGMENT_SHADER, name + ".frag", variant);
  const GLuint program = gl.CreateProgram();
  gl.AttachShader(program, vertex);
  gl.AttachShader(program, fragment);
  gl.LinkProgram(program);
  gl.DeleteShader(vertex);
  gl.DeleteShader(fragment);
  GLint ok = 0;
  gl.GetProgramiv(program, GL_LINK_STATUS, &ok);
  if (ok != GL_TRUE) {
    std::array<char, kLogSize> log{};
    gl.GetProgramInfoLog(program, static_cast<GLsizei>(log.size()), nullptr, log.data());
    gl.DeleteProgram(program);
    throw RenderError(fmt::format("shader {} {} does not link: {}", name, variant, log.data()));
  }
  const GLuint block = gl.GetUniformBlockIndex(program, "Frame");
  if (block != GL_INVALID_INDEX) gl.UniformBlockBinding(program, block, 0);
  return program;
}

MeshSlot& MeshCache::slot(const MeshPtr& mesh) {
  MeshSlot& slot = slots_[mesh.get()];
  // An expired slot belonged to another mesh at the same address.
  if (slot.index_count == 0 || slot.mesh.expired()) {
    slot = MeshSlot{};
    slot.mesh = mesh;
    append(*mesh, slot);
  }
  return slot;
}

void MeshCache::append(const Mesh& mesh, MeshSlot& slot) {
  slot.first_index = static_cast<std::uint32_t>(indices_.size());
  slot.index_count = static_cast<std::uint32_t>(mesh.indices.size());
  slot.base_vertex = static_cast<std::int32_t>(vertices_.size());
  slot.vertex_count = static_cast<std::uint32_t>(mesh.vertices.size());
  Eigen::AlignedBox3f bounds;
  for (const Vertex& vertex : mesh.vertices) {
    vertices_.push_back({floats(vertex.position), floats(vertex.normal)});
    bounds.extend(vertex.position);
  }
  indices_.insert(indices_.end(), mesh.indices.begin(), mesh.indices.end());
  slot.centre = bounds.center();
  for (const Vertex& vertex : mesh.vertices) {
    slot.radius = std::max(slot.radius, (vertex.position - slot.centre).norm());
  }
  changed_ = true;
}

void MeshCache::beginFrame() {
  ++frame_;
  ranks_ = 0;
  if (frame_ % kFramesBetweenSweeps == 0) sweep();
}

std::uint32_t MeshCache::rank(MeshSlot& slot) {
  if (slot.frame != frame_) {
    slot.frame = frame_;
    slot.rank = ranks_++;
  }
  return slot.rank;
}

void MeshCache::sweep() {
  std::size_t live_indices = 0;
  for (auto it = slots_.begin(); it != slots_.end();) {
    if (it->second.mesh.expired()) {
      it = slots_.erase(it);
    } else {
      live_indices += it->second.index_count;
      ++it;
    }
  }
  if (indices_.size() <= 2 * live_indices) return;
  vertices_.clear();
  indices_.clear();
  for (auto& [pointer, slot] : slots_) {
    if (const MeshPtr mesh = slot.mesh.lock()) {
      const std::uint64_t frame = slot.frame;
      slot = MeshSlot{};
      slot.mesh = mesh;
      slot.frame = frame;
      append(*mesh, slot);
    }
  }
}

bool MeshCache::takeChanged() {
  const bool changed = changed_;
  changed_ = false;
  return changed;
}

void FrameCollector::collect(const ViewRequest& request, Frame& frame) {
  const Camera& camera = request.camera;
  checkCamera(camera);
  frame_ = &frame;
  frame_->instances.clear();
  frame_->opaque.clear();
  frame_->alpha.clear();
  frame_->has_sky = false;
  lights_.clear();
  meshes_.beginFrame();
  setCamera(request);
  request.scene.forEach<Renderable>([&](Renderable& renderable) {
    if (camera.sees(renderable.gameObject().layer())) visit(renderable);
  });
  setLights();
  sort();
}

void FrameCollector::setCamera(const ViewRequest& request) {
  const Camera& camera = request.camera;
  const ImageSize size = request.size;
  Pose pose = camera.transform().pose();
  if (request.eye) pose = pose * request.eye->camera_T_eye;
  eye_position_ = pose.position;
  eye_from_world_ = pose.rotation.normalized().toRotationMatrix().transpose();
  const double near = camera.near_m;
  const double far = camera.far_m;
  const Frustum frustum =
      request.eye ? frustumOf(*request.eye) : frustumOf(camera.vertical_fov_deg, size);
  const double tan_x = frustum.half_width, tan_y = frustum.half_height;
  const double widest_x = tan_x + std::abs(frustum.middle_x);
  const double widest_y = tan_y + std::abs(frustum.middle_y);
  frame_->view = {static_cast<float>(near),
                  static_cast<float>(far),
                  static_cast<float>(widest_x),
                  static_cast<float>(widest_y),
                  static_cast<float>(std::hypot(1.0, widest_x)),
                  static_cast<float>(std::hypot(1.0, widest_y)),
                  static_cast<float>(size.height / (2.0 * tan_y))};
  FrameUniforms& u = frame_->uniforms;
  u.projection = {static_cast<float>(1.0 / tan_x), static_cast<float>(1.0 / tan_y),
                  static_cast<float>((far + near) / (far - near)),
                  static_cast<float>(-2.0 * far * near / (far - near))};
  u.depth_scale = {static_cast<float>(1.0 / far), static_cast<float>(frustum.middle_x / tan_x),
                   static_cast<float>(frustum.middle_y / tan_y), 0.0F};
  for (int row = 0; row < 3; ++row) {
    u.eye_from_world[static_cast<std::size_t>(row)] =
        vec4(eye_from_world_.row(row).transpose().cast<float>());
  }
  u.up = vec4(eye_from_world_.col(1).cast<float>());
  u.sky_high = u.sky_horizon = u.sky_ground = {};
  const Eigen::Vector3f background = linearRgb(camera.background);
  frame_->background = {background.x(), background.y(), background.z()};
}

void FrameCollector::visit(Renderable& renderable) {
  switch (renderable.kind()) {
    case Renderable::Kind::mesh:
      addMesh(static_cast<const MeshRenderer&>(renderable));
      break;
    case Renderable::Kind::billboards:
      addBillboards(static_cast<const Billboards&>(renderable));
      break;
    case Renderable::Kind::light: {
      const auto& light = static_cast<const DirectionalLight&>(renderable);
      addLight({-light.transform().forward(), linearRgb(light.color) * light.intensity});
      break;
    }
    case Renderable::Kind::skybox: {
      const auto& sky = static_cast<const Skybox&>(renderable);
      frame_->has_sky = true;
      frame_->sky = {sky.atmosphere_thickness, sky.exposure, sky.sky_tint, sky.ground,
                     Vec3::UnitY()};
      break;
    }
  }
}

void FrameCollector::addMesh(const MeshRenderer& renderer) {
  if (!renderer.visible || renderer.mesh == nullptr) return;
  const scene::Transform& transform = renderer.transform();
  const Eigen::Vector3f scale = transform.lossyScale().cast<float>();
  // Shown at size zero is not shown; its normals would be undefined too.
  if (!(scale.cwiseAbs().minCoeff() > 1e-9F)) return;
  const MeshSlot& slot = meshes_.slot(renderer.mesh);
  const Eigen::Matrix3f rotation =
      (eye_from_world_ * transform.rotation().toRotationMatrix()).cast<float>();
  const Eigen::Matrix3f linear = rotation * scale.asDiagonal();
  const Eigen::Vector3f origin =
      (eye_from_world_ * (transform.position() - eye_position_)).cast<float>();
  const Eigen::Vector3f centre = origin + linear * slot.centre;
  const float largest_scale = scale.cwiseAbs().maxCoeff();
  if (!frame_->view.sees(centre, slot.radius * largest_scale)) return;

  const Material& material = renderer.material;
  DrawItem item;
  item.distance_m = centre.norm();
  item.state = {shadingOf(material), material.cull_back, scale.prod() < 0.0F};
  InstanceData instance;
  for (int row = 0; row < 3; ++row) {
    instance.eye_from_mesh[static_cast<std::size_t>(row)] =
        vec4(linear.row(row).transpose(), origin[row]);
  }
  instance.normal_scale =
      vec4(scale.cwiseAbs2().cwiseInverse(), material.sky_reflections ? 1.0F : 0.0F);
  setSurface(material, material.blend == Material::Blend::opaque, instance);
  addItem(item, meshes_.slot(detailFor(renderer.mesh, largest_scale, centre.z())), instance,
          material.blend);
}

/// The coarsest of the mesh's stand-ins whose error does not show. A function of the view alone:
/// what was drawn before has no part in it.
const MeshPtr& FrameCollector::detailFor(const MeshPtr& mesh, float scale, float distance_m) const {
  const View& view = frame_->view;
  const float pixels = view.pixels * scale / std::max(distance_m, view.near_m);
  const MeshPtr* chosen = &mesh;
  for (const CoarserMesh& each : mesh->coarser) {
    if (each.error * pixels < kInvisible_px) chosen = &each.mesh;
  }
  return *chosen;
}

void FrameCollector::addBillboards(const Billboards& billboards) {
  if (billboards.billboards.empty()) return;
  MeshSlot& slot = meshes_.slot(quad());
  InstanceData instance{};
  instance.diffuse = vec4(linearRgb(billboards.color), billboards.color.a);
  for (const Billboard& billboard : billboards.billboards) {
    const auto size = static_cast<float>(billboard.size_m);
    const Eigen::Vector3f centre =
        (eye_from_world_ * (billboard.position_world - eye_position_)).cast<float>();
    if (!(size > 1e-9F) || !frame_->view.sees(centre, size * slot.radius)) continue;
    DrawItem item;
    item.distance_m = centre.norm();
    item.state = {Shading::unlit, true, false};
    instance.eye_from_mesh = {Vec4f{size, 0.0F, 0.0F, centre.x()},
                              Vec4f{0.0F, size, 0.0F, centre.y()},
                              Vec4f{0.0F, 0.0F, size, centre.z()}};
    addItem(item, slot, instance, Material::Blend::alpha);
  }
}

void FrameCollector::addItem(DrawItem item, MeshSlot& mesh, const InstanceData& instance,
                             Material::Blend blend) {
  meshes_.rank(mesh);
  item.mesh = &mesh;
  item.instance = static_cast<std::uint32_t>(frame_->instances.size());
  frame_->instances.push_back(instance);
  (blend == Material::Blend::opaque ? frame_->opaque : frame_->alpha).push_back(item);
}

/// Lights of one brightness stay in the scene's order.
void FrameCollector::addLight(const Light& light) {
  const auto place = std::upper_bound(
      lights_.begin(), lights_.end(), light,
      [](const Light& a, const Light& b) { return a.brightness() > b.brightness(); });
  lights_.insert(place, light);
}

void FrameCollector::setLights() {
  FrameUniforms& u = frame_->uniforms;
  u.main_direction = vec4((eye_from_world_ * Vec3::UnitY()).cast<float>());
  u.main_color = {};
  u.side_direction = {};
  u.side_color = {};
  for (std::size_t i = 0; i < std::min<std::size_t>(lights_.size(), 4); ++i) {
    const Vec4f direction = vec4((eye_from_world_ * lights_[i].towards_world).cast<float>());
    const Vec4f color = vec4(lights_[i].radiance);
    (i == 0 ? u.main_direction : u.side_direction[i - 1]) = direction;
    (i == 0 ? u.main_color : u.side_color[i - 1]) = color;
  }
  if (!lights_.empty()) frame_->sky.sun = lights_.front().towards_world;
}

void FrameCollector::sort() {
  // Ranks follow the scene's order, not addresses or upload history, so that equal scenes give
  // equal pictures even where surfaces coincide.
  const auto draw = [](const DrawItem& item) {
    return std::tuple(item.state, item.mesh->rank, item.instance);
  };
  std::sort(frame_->opaque.begin(), frame_->opaque.end(),
            [&](const DrawItem& a, const DrawItem& b) { return draw(a) < draw(b); });
  std::sort(frame_->alpha.begin(), frame_->alpha.end(), [](const DrawItem& a, const DrawItem& b) {
    return std::tuple(-a.distance_m, a.instance) < std::tuple(-b.distance_m, b.instance);
  });
}

}  // namespace sim2vr::render
