// SPDX-License-Identifier: Apache-2.0
// XR_KHR_vulkan_enable and XR_KHR_vulkan_enable2: images on the program's own device.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "graphics.hpp"
#include "pixels.hpp"
#include "vulkan_device.hpp"

#define XR_USE_GRAPHICS_API_VULKAN
#include <openxr/openxr_platform.h>

namespace sim2vr::openxr {
namespace {

constexpr std::uint32_t kSwapchainImages = 3;

struct VulkanFormat {
  VkFormat format;
  PixelFormat pixels;  // as vkCmdCopyImageToBuffer writes them
  VkImageAspectFlags aspects;
};

constexpr VkImageAspectFlags kDepthStencil =
    VK_IMAGE_ASPECT_DEPTH_BIT | VK_IMAGE_ASPECT_STENCIL_BIT;
constexpr std::array<VulkanFormat, 10> kFormats = {{
    {VK_FORMAT_R8G8B8A8_SRGB, PixelFormat::kRgba8Srgb, VK_IMAGE_ASPECT_COLOR_BIT},
    {VK_FORMAT_B8G8R8A8_SRGB, PixelFormat::kBgra8Srgb, VK_IMAGE_ASPECT_COLOR_BIT},
    {VK_FORMAT_R8G8B8A8_UNORM, PixelFormat::kRgba8Linear, VK_IMAGE_ASPECT_COLOR_BIT},
    {VK_FORMAT_B8G8R8A8_UNORM, PixelFormat::kBgra8Linear, VK_IMAGE_ASPECT_COLOR_BIT},
    {VK_FORMAT_R16G16B16A16_SFLOAT, PixelFormat::kRgba16Float, VK_IMAGE_ASPECT_COLOR_BIT},
    {VK_FORMAT_D32_SFLOAT, PixelFormat::kDepthFloat, VK_IMAGE_ASPECT_DEPTH_BIT},
    {VK_FORMAT_D24_UNORM_S8_UINT, PixelFormat::kDepth24, kDepthStencil},
    {VK_FORMAT_D32_SFLOAT_S8_UINT, PixelFormat::kDepthFloat, kDepthStencil},
    {VK_FORMAT_X8_D24_UNORM_PACK32, PixelFormat::kDepth24, VK_IMAGE_ASPECT_DEPTH_BIT},
    {VK_FORMAT_D16_UNORM, PixelFormat::kDepth16, VK_IMAGE_ASPECT_DEPTH_BIT},
}};

const VulkanFormat* findFormat(std::int64_t format) {
  const auto found = std::find_if(kFormats.begin(), kFormats.end(), [&](const VulkanFormat& one) {
    return static_cast<std::int64_t>(one.format) == format;
  });
  return found == kFormats.end() ? nullptr : &*found;
}

bool isColor(const VulkanFormat& format) { return format.aspects == VK_IMAGE_ASPECT_COLOR_BIT; }

/// The layout that the program finds at xrWaitSwapchainImage and leaves at release.
VkImageLayout attachmentLayout(const VulkanFormat& format) {
  return isColor(format) ? VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL
                         : VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
}

VkImageUsageFlags usageOf(const VulkanFormat& format, XrSwapchainUsageFlags wanted) {
  constexpr std::array<std::pair<XrSwapchainUsageFlags, VkImageUsageFlags>, 4> kUsages = {
      {{XR_SWAPCHAIN_USAGE_UNORDERED_ACCESS_BIT, VK_IMAGE_USAGE_STORAGE_BIT},
       {XR_SWAPCHAIN_USAGE_TRANSFER_DST_BIT, VK_IMAGE_USAGE_TRANSFER_DST_BIT},
       {XR_SWAPCHAIN_USAGE_SAMPLED_BIT, VK_IMAGE_USAGE_SAMPLED_BIT},
       {XR_SWAPCHAIN_USAGE_INPUT_ATTACHMENT_BIT_MND, VK_IMAGE_USAGE_INPUT_ATTACHMENT_BIT}}};
  VkImageUsageFlags usage = VK_IMAGE_USAGE_TRANSFER_SRC_BIT;  // we read every image
  usage |= isColor(format) ? VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT
                           : VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT;
  for (const auto& [xr, vk] : kUsages) usage |= (wanted & xr) != 0 ? vk : 0;
  return usage;
}

VkImageCreateInfo imageInfo(const VulkanFormat& format, const XrSwapchainCreateInfo& info) {
  VkImageCreateInfo made{};
  made.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO;
  if ((info.usageFlags & XR_SWAPCHAIN_USAGE_MUTABLE_FORMAT_BIT) != 0) {
    made.flags = VK_IMAGE_CREATE_MUTABLE_FORMAT_BIT;
  }
  made.imageType = VK_IMAGE_TYPE_2D;
  made.format = format.format;
  made.extent = {info.width, info.height, 1};
  made.mipLevels = info.mipCount;
  made.arrayLayers = info.arraySize;
  made.samples = static_cast<VkSampleCountFlagBits>(info.sampleCount);
  made.tiling = VK_IMAGE_TILING_OPTIMAL;
  made.usage = usageOf(format, info.usageFlags);
  made.sharingMode = VK_SHARING_MODE_EXCLUSIVE;
  made.initialLayout = VK_IMAGE_LAYOUT_UNDEFINED;
  return made;
}

struct Transition {
  VkImageLayout from;
  VkImageLayout to;
};

/// Everything before waits for everything after: the images are small and the work is ours.
void changeLayout(const VulkanDevice& device, VkCommandBuffer commands, VkImage image,
                  VkImageAspectFlags aspects, Transition layouts) {
  VkImageMemoryBarrier barrier{};
  barrier.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER;
  barrier.srcAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT;
  barrier.oldLayout = layouts.from;
  barrier.newLayout = layouts.to;
  barrier.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.image = image;
  barrier.subresourceRange = {aspects, 0, VK_REMAINING_MIP_LEVELS, 0, VK_REMAINING_ARRAY_LAYERS};
  device.vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT,
                               VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, 0, 0, nullptr, 0, nullptr, 1,
                               &barrier);
}

class VulkanImages final : public SwapchainImages {
 public:
  VulkanImages(std::shared_ptr<VulkanDevice> device, const XrSwapchainCreateInfo& info)
      : format(*findFormat(info.format)), device_(std::move(device)) {
    const bool once = (info.createFlags & XR_SWAPCHAIN_CREATE_STATIC_IMAGE_BIT) != 0;
    const VkImageCreateInfo image = imageInfo(format, info);
    try {
      for (std::uint32_t i = 0; i < (once ? 1 : kSwapchainImages); ++i) allocate(image);
      if (info.sampleCount > 1) {
        VkImageCreateInfo single = image;
        single.samples = VK_SAMPLE_COUNT_1_BIT;
        single.arrayLayers = 1;
        single.usage = VK_IMAGE_USAGE_TRANSFER_SRC_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT;
        allocate(single);
        resolved_ = images_.back();
        images_.pop_back();
      }
    } catch (...) {
      release();
      throw;
    }
  }

  ~VulkanImages() override {
    try {
      device_->wait();
    } catch (const GraphicsError&) {
      // The program's device is lost; what is left of it is destroyed all the same.
    }
    release();
  }

  std::uint32_t count() const override { return static_cast<std::uint32_t>(images_.size()); }

  void describe(XrSwapchainImageBaseHeader* images) const override {
    auto* list = reinterpret_cast<XrSwapchainImageVulkanKHR*>(images);
    for (std::size_t i = 0; i < images_.size(); ++i) list[i].image = images_[i];
  }

  void acquired(std::uint32_t /*index*/) override {
    if (ready_) return;
    const VkCommandBuffer commands = device_->begin();
    for (VkImage image : images_) {
      changeLayout(*device_, commands, image, format.aspects,
                   {VK_IMAGE_LAYOUT_UNDEFINED, attachmentLayout(format)});
    }
    device_->submit();
    ready_ = true;
  }

  /// Records the copy of one part into `buffer` at `offset`.
  void copy(VkCommandBuffer commands, const ImagePart& part, VkBuffer buffer,
            VkDeviceSize offset) const {
    const VkImage image = images_.at(part.index);
    const Transition to_source = {attachmentLayout(format), VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL};
    changeLayout(*device_, commands, image, format.aspects, to_source);
    if (resolved_ != VK_NULL_HANDLE) resolve(commands, part);
    VkBufferImageCopy region{};
    region.bufferOffset = offset;
    region.imageSubresource.aspectMask =
        isColor(format) ? VK_IMAGE_ASPECT_COLOR_BIT : VK_IMAGE_ASPECT_DEPTH_BIT;
    region.imageSubresource.baseArrayLayer = resolved_ != VK_NULL_HANDLE ? 0 : part.layer;
    region.imageSubresource.layerCount = 1;
    region.imageOffset = {part.rect.offset.x, part.rect.offset.y, 0};
    region.imageExtent = {static_cast<std::uint32_t>(part.rect.extent.width),
                          static_cast<std::uint32_t>(part.rect.extent.height), 1};
    device_->vk.CmdCopyImageToBuffer(commands, resolved_ != VK_NULL_HANDLE ? resolved_ : image,
                                     VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, buffer, 1, &region);
    changeLayout(*device_, commands, image, format.aspects, {to_source.to, to_source.from});
  }

  const VulkanFormat& format;

 private:
  void allocate(const VkImageCreateInfo& info) {
    VkImage image = VK_NULL_HANDLE;
    checkVk(device_->vk.CreateImage(device_->handle(), &info, nullptr, &image), "vkCreateImage");
    images_.push_back(image);
    VkMemoryRequirements needs{};
    device_->vk.GetImageMemoryRequirements(device_->handle(), image, &needs);
    memories_.push_back(device_->allocate(needs, 0));
    checkVk(device_->vk.BindImageMemory(device_->handle(), image, memories_.back(), 0),
            "vkBindImageMemory");
  }

  /// Averages the samples of the part's rectangle into the image of one sample.
  void resolve(VkCommandBuffer commands, const ImagePart& part) const {
    changeLayout(*device_, commands, resolved_, VK_IMAGE_ASPECT_COLOR_BIT,
                 {VK_IMAGE_LAYOUT_UNDEFINED, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL});
    VkImageResolve region{};
    region.srcSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, part.layer, 1};
    region.dstSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
    region.srcOffset = {part.rect.offset.x, part.rect.offset.y, 0};
    region.dstOffset = region.srcOffset;
    region.extent = {static_cast<std::uint32_t>(part.rect.extent.width),
                     static_cast<std::uint32_t>(part.rect.extent.height), 1};
    device_->vk.CmdResolveImage(commands, images_.at(part.index),
                                VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, resolved_,
                                VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &region);
    changeLayout(*device_, commands, resolved_, VK_IMAGE_ASPECT_COLOR_BIT,
                 {VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL});
  }

  void release() noexcept {
    for (VkImage image : images_) device_->vk.DestroyImage(device_->handle(), image, nullptr);
    device_->vk.DestroyImage(device_->handle(), resolved_, nullptr);
    for (VkDeviceMemory memory : memories_) {
      device_->vk.FreeMemory(device_->handle(), memory, nullptr);
    }
  }

  std::shared_ptr<VulkanDevice> device_;
  std::vector<VkImage> images_;
  std::vector<VkDeviceMemory> memories_;
  VkImage resolved_ = VK_NULL_HANDLE;
  bool ready_ = false;
};

class VulkanGraphics final : public Graphics {
 public:
  VulkanGraphics(std::string_view name, const VulkanBinding& binding)
      : name_(name), device_(std::make_shared<VulkanDevice>(binding)) {
    XrSwapchainCreateInfo plain{};
    plain.usageFlags = XR_SWAPCHAIN_USAGE_SAMPLED_BIT;
    for (const VulkanFormat& format : kFormats) {
      if (limits(format, plain).has_value()) formats_.push_back(format.format);
    }
  }

  std::string_view name() const override { return name_; }
  XrStructureType imageType() const override { return XR_TYPE_SWAPCHAIN_IMAGE_VULKAN_KHR; }
  std::span<const std::int64_t> formats() const override { return formats_; }
  bool isDepth(std::int64_t format) const override {
    const VulkanFormat* found = findFormat(format);
    return found != nullptr && !isColor(*found);
  }

  std::unique_ptr<SwapchainImages> createImages(const XrSwapchainCreateInfo& info) override {
    check(info);
    return std::make_unique<VulkanImages>(device_, info);
  }

  void prefetch(std::span<const ImagePart> parts) override {
    std::size_t bytes = 0;
    fetched_.clear();
    for (const ImagePart& part : parts) {
      fetched_.push_back({part, bytes});
      const std::size_t pixels = static_cast<std::size_t>(part.rect.extent.width) *
                                 static_cast<std::size_t>(part.rect.extent.height);
      bytes += (pixels * pixelBytes(imagesOf(part).format.pixels) + 15) / 16 * 16;
    }
    if (parts.empty()) return;
    const VkCommandBuffer commands = device_->begin();
    const VkBuffer buffer = device_->staging(bytes);
    for (const Fetched& one : fetched_) {
      imagesOf(one.part).copy(commands, one.part, buffer, one.offset);
    }
    writesAreForTheCpu(commands, buffer);
    device_->submit();
  }

  PixelView read(const ImagePart& part) override {
    const auto find = [&] {
      return std::find_if(fetched_.begin(), fetched_.end(),
                          [&](const Fetched& one) { return same(one.part, part); });
    };
    auto found = find();
    if (found == fetched_.end()) {
      prefetch({&part, 1});
      found = find();
    }
    const std::size_t offset = found->offset;
    fetched_.erase(found);
    device_->wait();
    return {imagesOf(part).format.pixels, device_->staged() + offset,
            static_cast<std::uint32_t>(part.rect.extent.width),
            static_cast<std::uint32_t>(part.rect.extent.height), false};
  }

 private:
  /// A part in the staging buffer; read once, so that no picture is shown again in a later frame.
  struct Fetched {
    ImagePart part;
    std::size_t offset;
  };

  static const VulkanImages& imagesOf(const ImagePart& part) {
    return static_cast<const VulkanImages&>(*part.images);
  }

  static bool same(const ImagePart& a, const ImagePart& b) {
    return a.images == b.images && a.index == b.index && a.layer == b.layer &&
           a.rect.offset.x == b.rect.offset.x && a.rect.offset.y == b.rect.offset.y &&
           a.rect.extent.width == b.rect.extent.width &&
           a.rect.extent.height == b.rect.extent.height;
  }

  void writesAreForTheCpu(VkCommandBuffer commands, VkBuffer buffer) const {
    VkBufferMemoryBarrier barrier{};
    barrier.sType = VK_STRUCTURE_TYPE_BUFFER_MEMORY_BARRIER;
    barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
    barrier.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.buffer = buffer;
    barrier.size = VK_WHOLE_SIZE;
    device_->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT,
                                   VK_PIPELINE_STAGE_HOST_BIT, 0, 0, nullptr, 1, &barrier, 0,
                                   nullptr);
  }

  /// What the device can do with such images; nothing: no such images.
  std::optional<VkImageFormatProperties> limits(const VulkanFormat& format,
                                                const XrSwapchainCreateInfo& info) const {
    const VkImageCreateInfo image = imageInfo(format, info);
    VkImageFormatProperties properties{};
    const VkResult result = device_->vk.GetPhysicalDeviceImageFormatProperties(
        device_->physical(), image.format, image.imageType, image.tiling, image.usage, image.flags,
        &properties);
    if (result != VK_SUCCESS) return std::nullopt;
    return properties;
  }

  void check(const XrSwapchainCreateInfo& info) const {
    if (std::find(formats_.begin(), formats_.end(), info.format) == formats_.end()) {
      throw GraphicsError(
          XR_ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED,
          fmt::format("format {} is none of xrEnumerateSwapchainFormats", info.format));
    }
    if (info.faceCount != 1 ||
        (info.createFlags & XR_SWAPCHAIN_CREATE_PROTECTED_CONTENT_BIT) != 0) {
      throw GraphicsError(XR_ERROR_FEATURE_UNSUPPORTED,
                          "cube maps and protected content are not supported");
    }
    const VulkanFormat& format = *findFormat(info.format);
    const auto most = limits(format, info);
    if (!most.has_value()) {
      throw GraphicsError(XR_ERROR_FEATURE_UNSUPPORTED,
                          fmt::format("the device has no images of format {} for usageFlags {:#x}",
                                      info.format, info.usageFlags));
    }
    checkSamples(format, info, *most);
    if (info.width > most->maxExtent.width || info.height > most->maxExtent.height ||
        info.arraySize > most->maxArrayLayers || info.mipCount > most->maxMipLevels) {
      throw GraphicsError(
          XR_ERROR_VALIDATION_FAILURE,
          fmt::format("an image of {} x {} x {} with {} levels is too large, expected at most "
                      "{} x {} x {} with {}",
                      info.width, info.height, info.arraySize, info.mipCount, most->maxExtent.width,
                      most->maxExtent.height, most->maxArrayLayers, most->maxMipLevels));
    }
  }

  static void checkSamples(const VulkanFormat& format, const XrSwapchainCreateInfo& info,
                           const VkImageFormatProperties& most) {
    if (info.sampleCount == 1) return;
    // Vulkan 1.0 resolves colour only outside a render pass.
    const bool possible = isColor(format) && info.mipCount == 1 &&
                          (most.sampleCounts & info.sampleCount) == info.sampleCount &&
                          (info.sampleCount & (info.sampleCount - 1)) == 0;
    if (possible) return;
    throw GraphicsError(XR_ERROR_FEATURE_UNSUPPORTED,
                        fmt::format("sampleCount is {}, expected 1, or for colour with one level a "
                                    "bit of {:#x}",
                                    info.sampleCount, most.sampleCounts));
  }

  std::string_view name_;
  std::shared_ptr<VulkanDevice> device_;
  std::vector<std::int64_t> formats_;
  std::vector<Fetched> fetched_;
};

std::unique_ptr<Graphics> create(std::string_view name, const XrBaseInStructure& binding) {
  const auto& vulkan = reinterpret_cast<const XrGraphicsBindingVulkanKHR&>(binding);
  if (vulkan.instance == VK_NULL_HANDLE || vulkan.physicalDevice == VK_NULL_HANDLE ||
      vulkan.device == VK_NULL_HANDLE) {
    throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                        "XrGraphicsBindingVulkanKHR lacks instance, physicalDevice or device");
  }
  const VulkanInstance known = findVulkanInstance(vulkan.instance);
  if (known.physical_device != VK_NULL_HANDLE && known.physical_device != vulkan.physicalDevice) {
    throw GraphicsError(XR_ERROR_GRAPHICS_DEVICE_INVALID,
                        "physicalDevice is not what xrGetVulkanGraphicsDeviceKHR returned");
  }
  return std::make_unique<VulkanGraphics>(
      name, VulkanBinding{known.lookup, vulkan.instance, vulkan.physicalDevice, vulkan.device,
                          vulkan.queueFamilyIndex, vulkan.queueIndex});
}

std::unique_ptr<Graphics> createLegacy(const XrBaseInStructure& binding) {
  return create("vulkan", binding);
}

std::unique_ptr<Graphics> create2(const XrBaseInStructure& binding) {
  return create("vulkan2", binding);
}

}  // namespace

GraphicsMaker vulkanMaker() {
  return {XR_KHR_VULKAN_ENABLE_EXTENSION_NAME,
          XR_KHR_vulkan_enable_SPEC_VERSION,
          XR_TYPE_GRAPHICS_BINDING_VULKAN_KHR,
          "xrGetVulkanGraphicsRequirementsKHR",
          createLegacy,
          vulkanFunction};
}

GraphicsMaker vulkan2Maker() {
  return {XR_KHR_VULKAN_ENABLE2_EXTENSION_NAME,
          XR_KHR_vulkan_enable2_SPEC_VERSION,
          XR_TYPE_GRAPHICS_BINDING_VULKAN2_KHR,
          "xrGetVulkanGraphicsRequirements2KHR",
          create2,
          vulkan2Function};
}

}  // namespace sim2vr::openxr
