#include <utility>

#include "world.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::uint64_t kIndexBits = 24;
constexpr std::size_t kMaximumObjects = 1U << 20U;

std::uint32_t indexOf(std::uint64_t handle) {
  return static_cast<std::uint32_t>((handle >> 8U) & ((1U << kIndexBits) - 1U));
}

}  // namespace

World& world() {
  static auto* instance = new World;
  return *instance;
}

std::uint64_t Handles::add(HandleType type, std::shared_ptr<Object> object, std::uint64_t parent) {
  std::uint32_t index = 0;
  if (!free_.empty()) {
    index = free_.back();
    free_.pop_back();
  } else if (entries_.size() < kMaximumObjects) {
    index = static_cast<std::uint32_t>(entries_.size());
    entries_.emplace_back();
  } else {
    throw Failure(XR_ERROR_LIMIT_REACHED, "more than 1048576 objects are alive");
  }
  Entry& entry = entries_[index];
  ++entry.generation;
  entry.type = type;
  const std::uint64_t handle = static_cast<std::uint64_t>(entry.generation) << 32U |
                               static_cast<std::uint64_t>(index) << 8U |
                               static_cast<std::uint64_t>(type);
  object->handle = handle;
  object->parent = parent;
  entry.object = std::move(object);
  return handle;
}

const Handles::Entry* Handles::entry(std::uint64_t handle) const {
  const std::uint32_t index = indexOf(handle);
  if (index >= entries_.size()) return nullptr;
  const Entry& found = entries_[index];
  return found.object && found.object->handle == handle ? &found : nullptr;
}

std::shared_ptr<Object> Handles::find(HandleType type, std::uint64_t handle) const {
  const Entry* found = entry(handle);
  return found != nullptr && found->type == type ? found->object : nullptr;
}

void Handles::remove(std::uint64_t handle) {
  if (entry(handle) == nullptr) return;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (entries_[i].object && entries_[i].object->parent == handle) {
      remove(entries_[i].object->handle);
    }
  }
  const std::uint32_t index = indexOf(handle);
  const std::shared_ptr<Object> last = std::exchange(entries_[index].object, nullptr);
  free_.push_back(index);
}

std::vector<std::shared_ptr<Object>> Handles::below(HandleType type, std::uint64_t parent) const {
  std::vector<std::shared_ptr<Object>> found;
  for (const Entry& each : entries_) {
    if (each.object && each.type == type && (parent == 0 || each.object->parent == parent)) {
      found.push_back(each.object);
    }
  }
  return found;
}

}  // namespace sim2vr::openxr
