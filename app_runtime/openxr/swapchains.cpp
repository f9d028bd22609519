// SPDX-License-Identifier: Apache-2.0
// Swapchains: acquire, wait, release, in this order for each image.
#include <algorithm>
#include <bit>

#include "api.hpp"
#include "calls.hpp"
#include "check.hpp"
#include "session.hpp"

namespace sim2vr::openxr {
namespace {

constexpr std::uint32_t kMaximumLayersOfImage = 64;
constexpr std::size_t kMaximumSwapchains = 256;
constexpr std::uint64_t kMaximumPixels = 1ULL << 28U;

void requireSize(const XrSwapchainCreateInfo& info) {
  const auto within = [](std::uint32_t value, std::uint32_t most, const char* name) {
    if (value >= 1 && value <= most) return;
    invalid(fmt::format("createInfo->{} is {}, expected 1 to {}", name, value, most));
  };
  within(info.width, kMaximumImageSize, "width");
  within(info.height, kMaximumImageSize, "height");
  within(info.mipCount, std::bit_width(std::max(info.width, info.height)), "mipCount");
  // The device's own limits are lower; it says so.
  within(info.sampleCount, 1U << 16U, "sampleCount");
  within(info.arraySize, 1U << 16U, "arraySize");
  if (info.arraySize > kMaximumLayersOfImage) {
    throw Failure(XR_ERROR_FEATURE_UNSUPPORTED,
                  fmt::format("createInfo->arraySize is {}, expected up to {}", info.arraySize,
                              kMaximumLayersOfImage));
  }
  if (info.faceCount == 6) {
    throw Failure(XR_ERROR_FEATURE_UNSUPPORTED, "createInfo->faceCount is 6: no cube layers");
  }
  within(info.faceCount, 1, "faceCount");
  const std::uint64_t pixels =
      static_cast<std::uint64_t>(info.width) * info.height * info.arraySize * info.sampleCount;
  if (pixels > kMaximumPixels) {
    throw Failure(
        XR_ERROR_OUT_OF_MEMORY,
        fmt::format("a swapchain image of {} pixels, expected up to {}", pixels, kMaximumPixels));
  }
}

void requireFlags(const XrSwapchainCreateInfo& info) {
  constexpr XrSwapchainCreateFlags kCreate =
      XR_SWAPCHAIN_CREATE_PROTECTED_CONTENT_BIT | XR_SWAPCHAIN_CREATE_STATIC_IMAGE_BIT;
  if ((info.createFlags & ~kCreate) != 0) {
    invalid(fmt::format("createInfo->createFlags is {:#x}", info.createFlags));
  }
  if ((info.createFlags & XR_SWAPCHAIN_CREATE_PROTECTED_CONTENT_BIT) != 0) {
    throw Failure(XR_ERROR_FEATURE_UNSUPPORTED, "no protected content");
  }
  constexpr XrSwapchainUsageFlags kUsage = 0xFF;  // all of 1.1
  if ((info.usageFlags & ~kUsage) != 0) {
    invalid(fmt::format("createInfo->usageFlags is {:#x}", info.usageFlags));
  }
}

std::shared_ptr<Swapchain> liveSwapchain(XrSwapchain handle) {
  auto swapchain = get<Swapchain>(handle, "swapchain");
  checkHarness(*swapchain->session);
  requireAlive(*swapchain->session);
  return swapchain;
}

[[noreturn]] void outOfOrder(const char* cause) {
  throw Failure(XR_ERROR_CALL_ORDER_INVALID, cause);
}

}  // namespace

XrResult XRAPI_CALL calls::xrEnumerateSwapchainFormats(XrSession session,
                                                       uint32_t formatCapacityInput,
                                                       uint32_t* formatCountOutput,
                                                       int64_t* formats) {
  return guarded("xrEnumerateSwapchainFormats", [&](Lock&) {
    const auto self = liveSession(session);
    std::span<const std::int64_t> known;
    if (self->graphics) known = self->graphics->formats();
    return fillItems(known, formatCapacityInput, formatCountOutput, formats, "formats");
  });
}

XrResult XRAPI_CALL calls::xrCreateSwapchain(XrSession session,
                                             const XrSwapchainCreateInfo* createInfo,
                                             XrSwapchain* swapchain) {
  return guarded("xrCreateSwapchain", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(createInfo, XR_TYPE_SWAPCHAIN_CREATE_INFO, "createInfo");
    requirePointer(swapchain, "swapchain");
    if (!self->graphics) throw Failure(XR_ERROR_FEATURE_UNSUPPORTED, "the session is headless");
    requireSize(info);
    requireFlags(info);
    const auto formats = self->graphics->formats();
    if (std::find(formats.begin(), formats.end(), info.format) == formats.end()) {
      throw Failure(
          XR_ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED,
          fmt::format("format {}, expected one of xrEnumerateSwapchainFormats", info.format));
    }
    if (world().handles.below(HandleType::swapchain, self->handle).size() >= kMaximumSwapchains) {
      throw Failure(XR_ERROR_LIMIT_REACHED, "256 swapchains are alive");
    }
    auto made = std::make_shared<Swapchain>();
    made->session = self;
    made->info = info;
    made->info.next = nullptr;
    made->is_static = (info.createFlags & XR_SWAPCHAIN_CREATE_STATIC_IMAGE_BIT) != 0;
    made->images = self->graphics->createImages(info);
    *swapchain = add<XrSwapchain>(made, self->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrDestroySwapchain(XrSwapchain swapchain) {
  return guarded("xrDestroySwapchain", [&](Lock&) {
    world().handles.remove(get<Swapchain>(swapchain, "swapchain")->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrEnumerateSwapchainImages(XrSwapchain swapchain,
                                                      uint32_t imageCapacityInput,
                                                      uint32_t* imageCountOutput,
                                                      XrSwapchainImageBaseHeader* images) {
  return guarded("xrEnumerateSwapchainImages", [&](Lock&) {
    const auto self = liveSwapchain(swapchain);
    if (wantsItems(self->images->count(), imageCapacityInput, imageCountOutput, images, "images")) {
      // Elements are larger than their header; the graphics know by how much, the first one's type
      // says whether they are right.
      requireTypes(images, 1, self->session->graphics->imageType(), "images");
      self->images->describe(images);
    }
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrAcquireSwapchainImage(XrSwapchain swapchain,
                                                   const XrSwapchainImageAcquireInfo* acquireInfo,
                                                   uint32_t* index) {
  return guarded("xrAcquireSwapchainImage", [&](Lock&) {
    const auto self = liveSwapchain(swapchain);
    optionalStructure(acquireInfo, XR_TYPE_SWAPCHAIN_IMAGE_ACQUIRE_INFO, "acquireInfo");
    requirePointer(index, "index");
    if (self->acquired.size() >= self->images->count()) {
      outOfOrder("all images of the swapchain are acquired");
    }
    if (self->is_static && (self->released || !self->acquired.empty())) {
      outOfOrder("a static swapchain's image is acquired once");
    }
    *index = self->next;
    self->images->acquired(self->next);
    self->acquired.push_back(self->next);
    self->next = (self->next + 1) % self->images->count();
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrWaitSwapchainImage(XrSwapchain swapchain,
                                                const XrSwapchainImageWaitInfo* waitInfo) {
  return guarded("xrWaitSwapchainImage", [&](Lock&) {
    const auto self = liveSwapchain(swapchain);
    structure(waitInfo, XR_TYPE_SWAPCHAIN_IMAGE_WAIT_INFO, "waitInfo");
    if (self->acquired.empty()) outOfOrder("no image of the swapchain is acquired");
    if (self->waited) outOfOrder("the acquired image was waited for already");
    self->waited = true;
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrReleaseSwapchainImage(XrSwapchain swapchain,
                                                   const XrSwapchainImageReleaseInfo* releaseInfo) {
  return guarded("xrReleaseSwapchainImage", [&](Lock&) {
    const auto self = liveSwapchain(swapchain);
    optionalStructure(releaseInfo, XR_TYPE_SWAPCHAIN_IMAGE_RELEASE_INFO, "releaseInfo");
    if (!self->waited) outOfOrder("the swapchain's image was not waited for");
    self->released = self->acquired.front();
    self->acquired.pop_front();
    self->waited = false;
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr
