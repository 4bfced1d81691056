// Part of the stub of the Zivid SDK: see Zivid/Zivid.h in this folder.
#pragma once
#include "../Zivid.h"

namespace Zivid::Experimental::SettingsInfo {
Resolution resolution(const CameraInfo &info, const Settings &settings);
Resolution resolution(const CameraInfo &info, const Settings2D &settings);
} // namespace Zivid::Experimental::SettingsInfo
