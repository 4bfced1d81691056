// As Zivid/Zivid.h of this folder says.
#pragma once

#define ZIVID_CORE_VERSION_MAJOR 2
#define ZIVID_CORE_VERSION_MINOR 17
