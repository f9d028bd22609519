"""The runtime's extensions, asked as a loader asks; run in a process of its own."""

from __future__ import annotations

import ctypes
import json
from pathlib import Path

GRAPHICS = {
    "XR_KHR_opengl_enable": "OpenGL (X11)",
    "XR_MNDX_egl_enable": "OpenGL (EGL)",
    "XR_KHR_vulkan_enable2": "Vulkan",
}
"""Extension of the runtime -> what a program may then draw with."""

_LOADER_INFO, _RUNTIME_REQUEST = 1, 3
_API_1_0 = 1 << 48
_API_MOST = (1 << 48) | (0x3FF << 32) | 0xFFFFFFFF
_EXTENSION_PROPERTIES = 2


class _LoaderInfo(ctypes.Structure):
    _fields_ = [
        ("type", ctypes.c_uint32),
        ("version", ctypes.c_uint32),
        ("size", ctypes.c_size_t),
        ("least_interface", ctypes.c_uint32),
        ("most_interface", ctypes.c_uint32),
        ("least_api", ctypes.c_uint64),
        ("most_api", ctypes.c_uint64),
    ]


class _RuntimeRequest(ctypes.Structure):
    _fields_ = [
        ("type", ctypes.c_uint32),
        ("version", ctypes.c_uint32),
        ("size", ctypes.c_size_t),
        ("interface", ctypes.c_uint32),
        ("api", ctypes.c_uint64),
        ("get", ctypes.c_void_p),
    ]


class _Extension(ctypes.Structure):
    _fields_ = [
        ("type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("name", ctypes.c_char * 128),
        ("version", ctypes.c_uint32),
    ]


def extensions_of(manifest: Path) -> list[str]:
    """Return the names of the extensions that a runtime has.

    Args:
        manifest: of the runtime.

    Raises:
        OSError, ValueError: its library cannot be loaded, or is no runtime.
    """
    name = json.loads(manifest.read_text())["runtime"]["library_path"]
    library = ctypes.CDLL(str((manifest.parent / name).resolve()))
    info = _LoaderInfo(_LOADER_INFO, 1, ctypes.sizeof(_LoaderInfo), 1, 1, _API_1_0, _API_MOST)
    request = _RuntimeRequest(_RUNTIME_REQUEST, 1, ctypes.sizeof(_RuntimeRequest), 0, 0, None)
    if library.xrNegotiateLoaderRuntimeInterface(ctypes.byref(info), ctypes.byref(request)) != 0:
        raise ValueError(f"{library._name}: refuses the loader's interface 1")
    get = ctypes.CFUNCTYPE(
        ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.POINTER(ctypes.c_void_p)
    )(request.get)
    address = ctypes.c_void_p()
    get(None, b"xrEnumerateInstanceExtensionProperties", ctypes.byref(address))
    enumerate_them = ctypes.CFUNCTYPE(
        ctypes.c_int,
        ctypes.c_char_p,
        ctypes.c_uint32,
        ctypes.POINTER(ctypes.c_uint32),
        ctypes.c_void_p,
    )(address.value or 0)
    count = ctypes.c_uint32()
    enumerate_them(None, 0, ctypes.byref(count), None)
    found = (_Extension * count.value)()
    for one in found:
        one.type = _EXTENSION_PROPERTIES
    enumerate_them(None, count.value, ctypes.byref(count), found)
    return [one.name.decode() for one in found]


def graphics_of(manifest: Path) -> str:
    """Return what programs may draw with, in words; raises as :func:`extensions_of`."""
    names = extensions_of(manifest)
    return ", ".join(words for name, words in GRAPHICS.items() if name in names) or "nothing"
