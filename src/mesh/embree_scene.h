#pragma once

#include "mesh/triangle_mesh.h"

struct RTCDeviceTy;
struct RTCSceneTy;

namespace handhold {

/// One device per process. threads=1 keeps Embree from starting workers; the instruction set is pinned to AVX2 where
/// the machine has it, because distances differ in the last digits between them.
RTCDeviceTy* embreeDevice();

/// @throws SystemError  the device has an error pending; `what` says what was done
void requireEmbree(const char* what);

/// The triangles of a mesh in a committed Embree scene, in robust mode. Without triangles it is empty.
/// @note  Const calls of Embree on handle() are safe from many threads.
class EmbreeScene {
 public:
  enum class Filter { none, context };  // context: a ray's context may bring a filter function

  explicit EmbreeScene(const TriangleMesh& mesh, Filter filter = Filter::none);
  ~EmbreeScene();
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  RTCSceneTy* handle() const { return scene_; }

 private:
  void addGeometry(const TriangleMesh& mesh);

  RTCSceneTy* scene_ = nullptr;
};

}  // namespace handhold
