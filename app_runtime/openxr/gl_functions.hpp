// The OpenGL functions that the runtime calls in the program's context, looked up at run time.
#pragma once

#include <GL/glcorearb.h>

#include <functional>

#define SIM2VR_XR_GL_FUNCTIONS(X)                              \
  X(PFNGLBINDBUFFERPROC, BindBuffer)                           \
  X(PFNGLBINDFRAMEBUFFERPROC, BindFramebuffer)                 \
  X(PFNGLBINDTEXTUREPROC, BindTexture)                         \
  X(PFNGLBLITFRAMEBUFFERPROC, BlitFramebuffer)                 \
  X(PFNGLCHECKFRAMEBUFFERSTATUSPROC, CheckFramebufferStatus)   \
  X(PFNGLDELETEFRAMEBUFFERSPROC, DeleteFramebuffers)           \
  X(PFNGLDELETETEXTURESPROC, DeleteTextures)                   \
  X(PFNGLDISABLEPROC, Disable)                                 \
  X(PFNGLENABLEPROC, Enable)                                   \
  X(PFNGLFRAMEBUFFERTEXTURE2DPROC, FramebufferTexture2D)       \
  X(PFNGLFRAMEBUFFERTEXTURELAYERPROC, FramebufferTextureLayer) \
  X(PFNGLGENFRAMEBUFFERSPROC, GenFramebuffers)                 \
  X(PFNGLGENTEXTURESPROC, GenTextures)                         \
  X(PFNGLGETERRORPROC, GetError)                               \
  X(PFNGLGETINTEGERVPROC, GetIntegerv)                         \
  X(PFNGLGETSTRINGPROC, GetString)                             \
  X(PFNGLGETTEXLEVELPARAMETERIVPROC, GetTexLevelParameteriv)   \
  X(PFNGLISENABLEDPROC, IsEnabled)                             \
  X(PFNGLPIXELSTOREIPROC, PixelStorei)                         \
  X(PFNGLREADPIXELSPROC, ReadPixels)                           \
  X(PFNGLTEXIMAGE2DMULTISAMPLEPROC, TexImage2DMultisample)     \
  X(PFNGLTEXIMAGE3DMULTISAMPLEPROC, TexImage3DMultisample)     \
  X(PFNGLTEXPARAMETERIPROC, TexParameteri)                     \
  X(PFNGLTEXSTORAGE2DPROC, TexStorage2D)                       \
  X(PFNGLTEXSTORAGE3DPROC, TexStorage3D)

namespace sim2vr::openxr {

struct GlFunctions {
  using Lookup = std::function<void*(const char* name)>;

  /// Fills the table; throws GraphicsError that names the first missing function.
  explicit GlFunctions(const Lookup& lookup);

#define SIM2VR_XR_GL_MEMBER(type, name) type name = nullptr;
  SIM2VR_XR_GL_FUNCTIONS(SIM2VR_XR_GL_MEMBER)
#undef SIM2VR_XR_GL_MEMBER
};

}  // namespace sim2vr::openxr
