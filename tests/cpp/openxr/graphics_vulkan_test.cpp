// SPDX-License-Identifier: Apache-2.0
// Swapchains of a program that draws with Vulkan, under Khronos' validation layer where it is
// installed: any warning or error fails the test. Expected bytes as in pixels_test.cpp.
#include <gtest/gtest.h>

#include <vector>

#include "graphics.hpp"
#include "typed.hpp"
#include "vulkan_device.hpp"
#include "vulkan_program.hpp"

#define XR_USE_GRAPHICS_API_VULKAN
#include <openxr/openxr_platform.h>

namespace sim2vr::openxr {
namespace {

XrSwapchainCreateInfo swapchain(std::int64_t format, std::uint32_t width, std::uint32_t height,
                                std::uint32_t layers = 1, std::uint32_t samples = 1) {
  return swapchainInfo(XR_SWAPCHAIN_USAGE_TRANSFER_DST_BIT, format, width, height, layers, samples);
}

class GraphicsVulkan : public testing::Test {
 protected:
  void SetUp() override {
    const auto problem = VulkanProgram::start(program_);
    if (problem.has_value()) GTEST_SKIP() << *problem;
    graphics_ = program_->graphics();
  }

  static std::vector<VkImage> imagesOf(const SwapchainImages& images) {
    std::vector<XrSwapchainImageVulkanKHR> list(
        images.count(), typed<XrSwapchainImageVulkanKHR>(XR_TYPE_SWAPCHAIN_IMAGE_VULKAN_KHR));
    images.describe(reinterpret_cast<XrSwapchainImageBaseHeader*>(list.data()));
    std::vector<VkImage> found;
    for (const auto& image : list) found.push_back(image.image);
    return found;
  }

  using Color = std::array<int, 4>;
  std::vector<Color> read(const ImagePart& part) {
    const auto width = static_cast<std::uint32_t>(part.rect.extent.width);
    const auto height = static_cast<std::uint32_t>(part.rect.extent.height);
    std::vector<std::uint8_t> rgba(std::size_t{width} * height * 4, 77);
    graphics_->readColor(part, width, height, rgba);
    std::vector<Color> colors;
    for (std::size_t i = 0; i < rgba.size(); i += 4) {
      colors.push_back({rgba[i], rgba[i + 1], rgba[i + 2], rgba[i + 3]});
    }
    return colors;
  }

  std::unique_ptr<VulkanProgram> program_;  // destroyed last: it counts what is left
  std::unique_ptr<Graphics> graphics_;
};

constexpr XrRect2Di kWhole = {{0, 0}, {6, 4}};

TEST_F(GraphicsVulkan, ColoursOfEveryFormat) {
  int seen = 0;
  for (const std::int64_t format : graphics_->formats()) {
    if (graphics_->isDepth(format)) continue;
    const auto images = graphics_->createImages(swapchain(format, 6, 4));
    images->acquired(1);
    program_->clearColor(imagesOf(*images)[1], 0, {0.2F, 1.0F, 0.0F, 0.4F});
    for (const Color& color : read({images.get(), 1, 0, kWhole})) {
      EXPECT_EQ(color, (Color{124, 255, 0, 102})) << format;  // Vulkan clears with linear values
    }
    ++seen;
  }
  EXPECT_EQ(seen, 5);
  EXPECT_EQ(graphics_->formats()[0], VK_FORMAT_R8G8B8A8_SRGB);
}

TEST_F(GraphicsVulkan, TheFirstRowStaysTheFirst) {
  const auto images = graphics_->createImages(swapchain(VK_FORMAT_B8G8R8A8_SRGB, 6, 4));
  images->acquired(0);
  std::vector<std::uint8_t> bytes;
  for (std::uint8_t i = 0; i < 24; ++i) bytes.insert(bytes.end(), {i, 100, 200, 255});
  program_->upload(imagesOf(*images)[0], 0, {6, 4}, bytes);
  const std::vector<Color> colors = read({images.get(), 0, 0, kWhole});
  for (int i = 0; i < 24; ++i) {
    EXPECT_EQ(colors[static_cast<std::size_t>(i)], (Color{200, 100, i, 255}));
  }
  const std::vector<Color> part = read({images.get(), 0, 0, {{2, 1}, {3, 2}}});
  EXPECT_EQ(part[0], (Color{200, 100, 8, 255}));
  EXPECT_EQ(part[5], (Color{200, 100, 16, 255}));
}

TEST_F(GraphicsVulkan, EyesFetchedTogether) {
  // Layers of an array, and halves of a double-wide image, in one submission.
  const auto array = graphics_->createImages(swapchain(VK_FORMAT_R8G8B8A8_UNORM, 6, 4, 2));
  const auto wide = graphics_->createImages(swapchain(VK_FORMAT_R16G16B16A16_SFLOAT, 10, 4));
  array->acquired(2);
  wide->acquired(0);
  program_->clearColor(imagesOf(*array)[2], 0, {1, 0, 0, 1});
  program_->clearColor(imagesOf(*array)[2], 1, {0, 0.2F, 0, 1});
  program_->clearColor(imagesOf(*wide)[0], 0, {0, 0, 0.5F, 1});
  const std::vector<ImagePart> parts = {{array.get(), 2, 0, kWhole},
                                        {array.get(), 2, 1, kWhole},
                                        {wide.get(), 0, 0, {{0, 0}, {5, 4}}},
                                        {wide.get(), 0, 0, {{5, 0}, {5, 4}}}};
  graphics_->prefetch(parts);
  EXPECT_EQ(read(parts[3])[19], (Color{0, 0, 188, 255}));
  EXPECT_EQ(read(parts[1])[23], (Color{0, 124, 0, 255}));
  EXPECT_EQ(read(parts[0])[0], (Color{255, 0, 0, 255}));
  EXPECT_EQ(read(parts[2])[0], (Color{0, 0, 188, 255}));
  // A part that was read is fetched anew.
  program_->clearColor(imagesOf(*array)[2], 0, {0, 0, 1, 1});
  EXPECT_EQ(read(parts[0])[0], (Color{0, 0, 255, 255}));
}

TEST_F(GraphicsVulkan, SamplesAreAveraged) {
  for (const std::uint32_t layers : {1U, 2U}) {
    const auto images =
        graphics_->createImages(swapchain(VK_FORMAT_R8G8B8A8_SRGB, 6, 4, layers, 4));
    images->acquired(0);
    program_->clearColor(imagesOf(*images)[0], layers - 1, {0.2F, 1, 0, 1});
    for (const Color& color : read({images.get(), 0, layers - 1, kWhole})) {
      EXPECT_EQ(color, (Color{124, 255, 0, 255}));
    }
  }
}

TEST_F(GraphicsVulkan, DepthOfEveryFormat) {
  int seen = 0;
  for (const std::int64_t format : graphics_->formats()) {
    if (!graphics_->isDepth(format)) continue;
    const auto images = graphics_->createImages(swapchain(format, 6, 4));
    images->acquired(0);
    const bool stencil =
        format == VK_FORMAT_D24_UNORM_S8_UINT || format == VK_FORMAT_D32_SFLOAT_S8_UINT;
    program_->clearDepth(
        imagesOf(*images)[0],
        VK_IMAGE_ASPECT_DEPTH_BIT | (stencil ? VkImageAspectFlags{VK_IMAGE_ASPECT_STENCIL_BIT} : 0),
        0.25F);
    std::array<float, 24> depth{};
    graphics_->readDepth({images.get(), 0, 0, kWhole}, 6, 4, depth);
    for (const float value : depth) EXPECT_NEAR(value, 0.25F, 1.0F / 65535) << format;
    ++seen;
  }
  EXPECT_GE(seen, 2);
}

TEST_F(GraphicsVulkan, ImagesThatWereNeverReadAndMipLevels) {
  XrSwapchainCreateInfo info = swapchain(VK_FORMAT_R8G8B8A8_SRGB, 8, 4);
  info.mipCount = 3;
  info.usageFlags |= XR_SWAPCHAIN_USAGE_MUTABLE_FORMAT_BIT;
  const auto images = graphics_->createImages(info);
  EXPECT_EQ(images->count(), 3U);
  info.createFlags = XR_SWAPCHAIN_CREATE_STATIC_IMAGE_BIT;
  auto once = graphics_->createImages(info);
  EXPECT_EQ(once->count(), 1U);
  once->acquired(0);
  const ImagePart part = {once.get(), 0, 0, kWhole};
  graphics_->prefetch({&part, 1});
  once.reset();  // waits for the copy
}

TEST_F(GraphicsVulkan, SwapchainsThatCannotBe) {
  const auto refused = [&](const XrSwapchainCreateInfo& info) {
    try {
      graphics_->createImages(info);
    } catch (const GraphicsError& error) {
      return error.result();
    }
    return XR_SUCCESS;
  };
  const std::int64_t rgba = VK_FORMAT_R8G8B8A8_UNORM;
  EXPECT_EQ(refused(swapchain(VK_FORMAT_R5G6B5_UNORM_PACK16, 6, 4)),
            XR_ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED);
  EXPECT_EQ(refused(swapchain(rgba, 6, 4, 1, 3)), XR_ERROR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(refused(swapchain(rgba, 6, 4, 1, 1024)), XR_ERROR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(refused(swapchain(VK_FORMAT_D32_SFLOAT, 6, 4, 1, 4)), XR_ERROR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(refused(swapchain(rgba, 1U << 20U, 4)), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(refused(swapchain(rgba, 6, 4, 1U << 20U)), XR_ERROR_VALIDATION_FAILURE);
  XrSwapchainCreateInfo info = swapchain(rgba, 6, 6);
  info.faceCount = 6;
  EXPECT_EQ(refused(info), XR_ERROR_FEATURE_UNSUPPORTED);
  info = swapchain(rgba, 6, 6);
  info.createFlags = XR_SWAPCHAIN_CREATE_PROTECTED_CONTENT_BIT;
  EXPECT_EQ(refused(info), XR_ERROR_FEATURE_UNSUPPORTED);
}

TEST_F(GraphicsVulkan, BindingsThatCannotBe) {
  const auto refused = [&](const XrGraphicsBindingVulkanKHR& binding) {
    try {
      vulkanMaker().create(reinterpret_cast<const XrBaseInStructure&>(binding));
    } catch (const GraphicsError& error) {
      return error.result();
    }
    return XR_SUCCESS;
  };
  auto binding = typed<XrGraphicsBindingVulkanKHR>(XR_TYPE_GRAPHICS_BINDING_VULKAN_KHR);
  EXPECT_EQ(refused(binding), XR_ERROR_GRAPHICS_DEVICE_INVALID);
  binding.instance = program_->instance;
  binding.physicalDevice = program_->physical_device;
  binding.device = program_->device;
  EXPECT_EQ(refused(binding), XR_SUCCESS);
  binding.queueFamilyIndex = 99;
  EXPECT_EQ(refused(binding), XR_ERROR_GRAPHICS_DEVICE_INVALID);
  binding.queueFamilyIndex = 0;
  binding.physicalDevice = reinterpret_cast<VkPhysicalDevice>(&binding);
  EXPECT_EQ(refused(binding), XR_ERROR_GRAPHICS_DEVICE_INVALID);
}

TEST_F(GraphicsVulkan, CallsBeforeASession) {
  const auto text = reinterpret_cast<PFN_xrGetVulkanInstanceExtensionsKHR>(
      vulkanFunction("xrGetVulkanInstanceExtensionsKHR"));
  std::uint32_t count = 0;
  std::array<char, 4> buffer = {'x', 'x', 'x', 'x'};
  EXPECT_EQ(text(XR_NULL_HANDLE, 1, 0, &count, nullptr), XR_SUCCESS);
  EXPECT_EQ(count, 1U);
  EXPECT_EQ(text(XR_NULL_HANDLE, 1, 4, &count, buffer.data()), XR_SUCCESS);
  EXPECT_STREQ(buffer.data(), "");
  EXPECT_EQ(text(XR_NULL_HANDLE, 1, 4, &count, nullptr), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(text(XR_NULL_HANDLE, 2, 0, &count, nullptr), XR_ERROR_SYSTEM_INVALID);
  const auto device = reinterpret_cast<PFN_xrGetVulkanGraphicsDeviceKHR>(
      vulkanFunction("xrGetVulkanGraphicsDeviceKHR"));
  VkPhysicalDevice found = VK_NULL_HANDLE;
  EXPECT_EQ(device(XR_NULL_HANDLE, 1, VK_NULL_HANDLE, &found), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(device(XR_NULL_HANDLE, 1, program_->instance, &found), XR_SUCCESS);
  EXPECT_EQ(found, program_->physical_device);
  const auto requirements = reinterpret_cast<PFN_xrGetVulkanGraphicsRequirements2KHR>(
      vulkan2Function("xrGetVulkanGraphicsRequirements2KHR"));
  auto wanted = typed<XrGraphicsRequirementsVulkanKHR>(XR_TYPE_GRAPHICS_REQUIREMENTS_VULKAN_KHR);
  EXPECT_EQ(requirements(XR_NULL_HANDLE, 1, &wanted), XR_SUCCESS);
  EXPECT_EQ(wanted.minApiVersionSupported, XR_MAKE_VERSION(1, 0, 0));
  wanted.type = XR_TYPE_UNKNOWN;
  EXPECT_EQ(requirements(XR_NULL_HANDLE, 1, &wanted), XR_ERROR_VALIDATION_FAILURE);
}

TEST_F(GraphicsVulkan, DevicesOnlyOnThePhysicalDeviceThatWasNamed) {
  VkDeviceCreateInfo nothing{};
  auto info = typed<XrVulkanDeviceCreateInfoKHR>(XR_TYPE_VULKAN_DEVICE_CREATE_INFO_KHR);
  info.systemId = 1;
  info.pfnGetInstanceProcAddr = [](VkInstance, const char*) { return PFN_vkVoidFunction{}; };
  info.vulkanCreateInfo = &nothing;
  info.vulkanPhysicalDevice = reinterpret_cast<VkPhysicalDevice>(&info);
  VkDevice device = VK_NULL_HANDLE;
  VkResult result = VK_SUCCESS;
  const auto create =
      reinterpret_cast<PFN_xrCreateVulkanDeviceKHR>(vulkan2Function("xrCreateVulkanDeviceKHR"));
  EXPECT_EQ(create(XR_NULL_HANDLE, &info, &device, &result), XR_ERROR_HANDLE_INVALID);
  info.vulkanPhysicalDevice = program_->physical_device;
  EXPECT_EQ(create(XR_NULL_HANDLE, &info, &device, &result), XR_ERROR_RUNTIME_FAILURE);
  info.pfnGetInstanceProcAddr = nullptr;
  EXPECT_EQ(create(XR_NULL_HANDLE, &info, &device, &result), XR_ERROR_VALIDATION_FAILURE);
  info.systemId = 2;
  EXPECT_EQ(create(XR_NULL_HANDLE, nullptr, &device, &result), XR_ERROR_VALIDATION_FAILURE);
}

}  // namespace
}  // namespace sim2vr::openxr
