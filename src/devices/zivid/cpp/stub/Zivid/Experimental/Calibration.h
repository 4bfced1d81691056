// Part of the stub of the Zivid SDK: see Zivid/Zivid.h in this folder.
#pragma once
#include "../Zivid.h"

namespace Zivid::Experimental::Calibration {
CameraIntrinsics intrinsics(const Camera &camera, const Settings &settings);
CameraIntrinsics intrinsics(const Camera &camera, const Settings2D &settings);
} // namespace Zivid::Experimental::Calibration
