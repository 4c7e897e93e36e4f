#include "mesh/embree_scene.h"

#include "core/error.h"

#include <algorithm>

#include <embree3/rtcore.h>
#include <fmt/format.h>

namespace handhold {

void requireEmbree(const char* what) {
  const RTCError error = rtcGetDeviceError(embreeDevice());
  if (error != RTC_ERROR_NONE) {
    throw SystemError(fmt::format("embree: {} failed with error {}", what, static_cast<int>(error)));
  }
}

RTCDeviceTy* embreeDevice() {
  struct Device {
    RTCDevice handle = nullptr;
    Device() {
      const bool avx2 = __builtin_cpu_supports("avx2") != 0;
      handle = rtcNewDevice(avx2 ? "threads=1,set_affinity=0,isa=avx2" : "threads=1,set_affinity=0");
      if (handle == nullptr) {
        const int error = static_cast<int>(rtcGetDeviceError(nullptr));
        throw SystemError(fmt::format("embree: opening the device failed with error {}", error));
      }
    }
    ~Device() { rtcReleaseDevice(handle); }
  };
  static const Device device;
  return device.handle;
}

EmbreeScene::EmbreeScene(const TriangleMesh& mesh, Filter filter) : scene_(rtcNewScene(embreeDevice())) {
  const int flags = filter == Filter::context ? RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION
                                              : RTC_SCENE_FLAG_ROBUST;
  rtcSetSceneFlags(scene_, static_cast<RTCSceneFlags>(flags));
  try {
    if (!mesh.triangles.empty()) addGeometry(mesh);
    rtcCommitScene(scene_);
    requireEmbree("building the scene");
  } catch (...) {
    rtcReleaseScene(scene_);
    throw;
  }
}

EmbreeScene::~EmbreeScene() { rtcReleaseScene(scene_); }

void EmbreeScene::addGeometry(const TriangleMesh& mesh) {
  RTCGeometry geometry = rtcNewGeometry(embreeDevice(), RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertex = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                             3 * sizeof(float), mesh.vertices.size()));
  auto* index = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t), mesh.triangles.size()));
  if (vertex != nullptr && index != nullptr) {
    for (const auto& v : mesh.vertices) vertex = std::copy_n(v.cast<float>().eval().data(), 3, vertex);
    for (const auto& t : mesh.triangles) index = std::copy_n(t.data(), 3, index);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
  }
  rtcReleaseGeometry(geometry);
  requireEmbree("copying the mesh");
}

}  // namespace handhold
