// As Zivid/Zivid.h of this folder says.
#pragma once
#include "../Zivid.h"

namespace Zivid::Experimental::SettingsInfo {
Resolution resolution(const CameraInfo &info, const Settings &settings);
Resolution resolution(const CameraInfo &info, const Settings2D &settings);
} // namespace Zivid::Experimental::SettingsInfo
