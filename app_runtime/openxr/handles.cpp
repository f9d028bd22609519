// SPDX-License-Identifier: Apache-2.0
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
  if (children(parent) == nullptr) {
    throw Failure(XR_ERROR_HANDLE_INVALID, "the parent is no living handle");
  }
  std::uint32_t index = free_;
  if (index != kNone) {
    free_ = entries_[index].next;
  } else if (entries_.size() < kMaximumObjects) {
    index = static_cast<std::uint32_t>(entries_.size());
    entries_.emplace_back();
  } else {
    throw Failure(XR_ERROR_LIMIT_REACHED, "more than 1048576 objects are alive");
  }
  auto& siblings = const_cast<List&>(*children(parent));
  Entry& entry = entries_[index];
  ++entry.generation;
  entry.type = type;
  entry.next = kNone;
  entry.previous = siblings.last;
  (siblings.last == kNone ? siblings.first : entries_[siblings.last].next) = index;
  siblings.last = index;
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

const Handles::List* Handles::children(std::uint64_t parent) const {
  if (parent == 0) return &instances_;
  const Entry* found = entry(parent);
  return found != nullptr ? &found->children : nullptr;
}

void Handles::remove(std::uint64_t handle) noexcept {
  if (entry(handle) == nullptr) return;
  const std::uint32_t index = indexOf(handle);
  Entry& gone = entries_[index];
  while (gone.children.first != kNone) remove(entries_[gone.children.first].object->handle);
  auto& siblings = const_cast<List&>(*children(gone.object->parent));
  (gone.previous == kNone ? siblings.first : entries_[gone.previous].next) = gone.next;
  (gone.next == kNone ? siblings.last : entries_[gone.next].previous) = gone.previous;
  gone.next = std::exchange(free_, index);
  const std::shared_ptr<Object> last = std::exchange(gone.object, nullptr);
}

std::vector<std::shared_ptr<Object>> Handles::below(HandleType type, std::uint64_t parent) const {
  std::vector<std::shared_ptr<Object>> found;
  const List* of_parent = children(parent);
  if (of_parent == nullptr) return found;
  for (std::uint32_t i = of_parent->first; i != kNone; i = entries_[i].next) {
    if (entries_[i].type == type) found.push_back(entries_[i].object);
  }
  return found;
}

}  // namespace sim2vr::openxr
