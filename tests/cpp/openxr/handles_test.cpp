// SPDX-License-Identifier: Apache-2.0
// The table of handles: what lies below what, and that many handles cost no more each than few.
#include <gtest/gtest.h>

#include "failing_memory.hpp"
#include "objects.hpp"

namespace sim2vr::openxr::test {
namespace {

std::uint64_t added(Handles& handles, HandleType type, std::uint64_t parent) {
  return handles.add(type, std::make_shared<Object>(), parent);
}

std::vector<std::uint64_t> below(const Handles& handles, HandleType type, std::uint64_t parent) {
  std::vector<std::uint64_t> found;
  for (const auto& object : handles.below(type, parent)) found.push_back(object->handle);
  return found;
}

using Found = std::vector<std::uint64_t>;

TEST(Handles, ChildrenAreOfTheirParentInTheOrderOfTheirMaking) {
  Handles handles;
  const auto instance = added(handles, HandleType::instance, 0);
  const auto other = added(handles, HandleType::instance, 0);
  const auto session = added(handles, HandleType::session, instance);
  const auto first = added(handles, HandleType::space, session);
  const auto swapchain = added(handles, HandleType::swapchain, session);
  const auto second = added(handles, HandleType::space, session);
  const auto third = added(handles, HandleType::space, session);
  EXPECT_EQ(below(handles, HandleType::instance, 0), (Found{instance, other}));
  EXPECT_EQ(below(handles, HandleType::space, session), (Found{first, second, third}));
  EXPECT_EQ(below(handles, HandleType::space, instance), Found{});
  EXPECT_EQ(below(handles, HandleType::session, other), Found{});
  // From the middle, the end and the beginning; the next one takes a free entry.
  handles.remove(second);
  EXPECT_EQ(below(handles, HandleType::space, session), (Found{first, third}));
  handles.remove(third);
  const auto fourth = added(handles, HandleType::space, session);
  EXPECT_EQ(below(handles, HandleType::space, session), (Found{first, fourth}));
  handles.remove(first);
  EXPECT_EQ(below(handles, HandleType::space, session), Found{fourth});
  EXPECT_EQ(handles.find(HandleType::space, third), nullptr);
  EXPECT_EQ(below(handles, HandleType::swapchain, session), Found{swapchain});
  // With everything below it, and with nothing else.
  handles.remove(instance);
  EXPECT_EQ(handles.find(HandleType::session, session), nullptr);
  EXPECT_EQ(handles.find(HandleType::space, fourth), nullptr);
  EXPECT_EQ(handles.find(HandleType::swapchain, swapchain), nullptr);
  EXPECT_EQ(below(handles, HandleType::instance, 0), Found{other});
  EXPECT_EQ(below(handles, HandleType::space, session), Found{});
  EXPECT_THROW(added(handles, HandleType::space, session), Failure);
}

TEST(Handles, RemovalAllocatesNothingAndEndsWithManyToo) {
  // Looking at every entry for each that goes would be 10^11 steps.
  constexpr std::size_t kMany = 300'000;
  Handles handles;
  const auto instance = added(handles, HandleType::instance, 0);
  const auto session = added(handles, HandleType::session, instance);
  Found spaces;
  for (std::size_t i = 0; i < kMany; ++i) {
    spaces.push_back(added(handles, HandleType::space, session));
  }
  {
    const FailingMemory none(0);
    for (std::size_t i = 0; i < kMany; i += 2) handles.remove(spaces[i]);
  }
  EXPECT_EQ(handles.below(HandleType::space, session).size(), kMany / 2);
  {
    const FailingMemory none(0);
    handles.remove(session);
  }
  EXPECT_EQ(handles.find(HandleType::space, spaces[1]), nullptr);
  EXPECT_EQ(below(handles, HandleType::instance, 0), Found{instance});
  // All entries are free again: as many fit as into a new table.
  const auto next = added(handles, HandleType::session, instance);
  constexpr std::size_t kMost = 1U << 20U;
  for (std::size_t i = 2; i < kMost; ++i) added(handles, HandleType::space, next);
  EXPECT_THROW(added(handles, HandleType::space, next), Failure);
}

}  // namespace
}  // namespace sim2vr::openxr::test
