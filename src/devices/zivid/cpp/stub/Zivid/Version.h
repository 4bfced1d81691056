// Part of the stub of the Zivid SDK: see Zivid/Zivid.h in this folder.
#pragma once

#define ZIVID_CORE_VERSION_MAJOR 2
#define ZIVID_CORE_VERSION_MINOR 17
