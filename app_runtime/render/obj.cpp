// Wavefront OBJ reader.
#include <fmt/format.h>

#include <charconv>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <tuple>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/mesh.hpp"

namespace sim2vr::render {
namespace {

class ObjReader {
 public:
  explicit ObjReader(const std::filesystem::path& path) : path_(path) {
    mesh_.name = path.filename().string();
  }

  MeshPtr read() {
    std::ifstream file(path_);
    if (!file) throw InvalidArgument("mesh file", path_.string(), "a readable Wavefront OBJ file");
    std::string line;
    while (std::getline(file, line)) {
      ++line_number_;
      statement(line);
    }
    if (mesh_.indices.empty()) {
      throw InvalidArgument("mesh file", path_.string() + " without faces",
                            "at least one face (f)");
    }
    return share(std::move(mesh_));
  }

 private:
  struct Corner {
    int position = -1;
    int uv = -1;
    int normal = -1;
    auto operator<=>(const Corner&) const = default;
  };

  [[noreturn]] void fail(const std::string& got, const std::string& expected) const {
    throw InvalidArgument(fmt::format("{} line {}", path_.string(), line_number_), got, expected);
  }

  void statement(const std::string& line) {
    std::istringstream words(line);
    std::string keyword;
    words >> keyword;
    if (keyword == "v") {
      positions_.push_back(unityFrame(numbers<3>(words, line)));
    } else if (keyword == "vn") {
      const Eigen::Vector3f normal = unityFrame(numbers<3>(words, line));
      if (normal.norm() < 1e-9F) fail("'" + line + "'", "a normal longer than 0");
      normals_.push_back(normal.normalized());
    } else if (keyword == "vt") {
      uvs_.push_back(numbers<2>(words, line));
    } else if (keyword == "f") {
      face(words);
    }
  }

  /// OBJ is right-handed; negating x (and reversing the corners, see face) gives the app's frame.
  static Eigen::Vector3f unityFrame(const Eigen::Vector3f& obj) {
    return {-obj.x(), obj.y(), obj.z()};
  }

  template <int N>
  Eigen::Matrix<float, N, 1> numbers(std::istringstream& words, const std::string& line) const {
    Eigen::Matrix<float, N, 1> values;
    for (int i = 0; i < N; ++i) {
      if (!(words >> values[i])) fail("'" + line + "'", fmt::format("{} numbers", N));
    }
    return values;
  }

  void face(std::istringstream& words) {
    std::vector<Corner> corners;
    std::string word;
    while (words >> word) corners.push_back(corner(word));
    if (corners.size() < 3) fail(fmt::format("a face of {} corners", corners.size()), "at least 3");
    std::vector<std::uint32_t> ids;
    const Eigen::Vector3f flat = faceNormal(corners);
    for (const Corner& each : corners) ids.push_back(vertex(each, flat));
    for (std::size_t i = 1; i + 1 < ids.size(); ++i) {
      mesh_.indices.insert(mesh_.indices.end(), {ids[0], ids[i + 1], ids[i]});
    }
  }

  Corner corner(const std::string& word) const {
    Corner result;
    int* const slots[] = {&result.position, &result.uv, &result.normal};
    const std::size_t counts[] = {positions_.size(), uvs_.size(), normals_.size()};
    std::size_t begin = 0;
    for (int part = 0; part < 3 && begin <= word.size(); ++part) {
      const std::size_t end = std::min(word.find('/', begin), word.size());
      if (end > begin) *slots[part] = index(word, word.substr(begin, end - begin), counts[part]);
      begin = end + 1;
    }
    if (result.position < 0) fail("the corner '" + word + "'", "position[/uv[/normal]]");
    return result;
  }

  /// OBJ counts from 1, or from the end with negative numbers.
  int index(const std::string& word, const std::string& text, std::size_t count) const {
    int value = 0;
    const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || rest != text.data() + text.size()) {
      fail("the corner '" + word + "'", "whole numbers separated by '/'");
    }
    const long long zero_based = value < 0 ? static_cast<long long>(count) + value : value - 1LL;
    if (zero_based < 0 || zero_based >= static_cast<long long>(count)) {
      fail("the corner '" + word + "'", fmt::format("an index among the {} read so far", count));
    }
    return static_cast<int>(zero_based);
  }

  /// Newell's normal of the polygon, in the app's frame.
  Eigen::Vector3f faceNormal(const std::vector<Corner>& corners) const {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (std::size_t i = 0; i < corners.size(); ++i) {
      sum += positions_[static_cast<std::size_t>(corners[(i + 1) % corners.size()].position)].cross(
          positions_[static_cast<std::size_t>(corners[i].position)]);
    }
    const float length = sum.norm();
    return length > 0.0F ? Eigen::Vector3f(sum / length) : Eigen::Vector3f::UnitY();
  }

  std::uint32_t vertex(const Corner& corner, const Eigen::Vector3f& flat_normal) {
    const auto found = corner.normal < 0 ? shared_.end() : shared_.find(corner);
    if (found != shared_.end()) return found->second;
    Vertex made;
    made.position = positions_[static_cast<std::size_t>(corner.position)];
    made.normal =
        corner.normal < 0 ? flat_normal : normals_[static_cast<std::size_t>(corner.normal)];
    if (corner.uv >= 0) made.uv = uvs_[static_cast<std::size_t>(corner.uv)];
    mesh_.vertices.push_back(made);
    const auto id = static_cast<std::uint32_t>(mesh_.vertices.size() - 1);
    if (corner.normal >= 0) shared_.emplace(corner, id);
    return id;
  }

  std::filesystem::path path_;
  int line_number_ = 0;
  std::vector<Eigen::Vector3f> positions_;
  std::vector<Eigen::Vector3f> normals_;
  std::vector<Eigen::Vector2f> uvs_;
  std::map<Corner, std::uint32_t> shared_;
  Mesh mesh_;
};

}  // namespace

MeshPtr loadObj(const std::filesystem::path& path) { return ObjReader(path).read(); }

}  // namespace sim2vr::render
