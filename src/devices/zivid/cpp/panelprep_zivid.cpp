// The implementation of the interface in panelprep_zivid.h with the Zivid SDK. CALLS.md lists each call of the SDK with
// the public sample that contains it, and marks those that no sample contains. This file is compiled with the SDK on
// the cell's computer (make zivid), and without the SDK with the declarations in stub/ (make zivid-stub).

#include "panelprep_zivid.h"

#include <Zivid/Version.h>

#if ZIVID_CORE_VERSION_MAJOR < 2 || (ZIVID_CORE_VERSION_MAJOR == 2 && ZIVID_CORE_VERSION_MINOR < 17)
#error "Panelprep needs the Zivid SDK 2.17.0 or newer: older versions do not report how long a hot camera \
    paused (throttlingTime)"
#endif

#include <Zivid/Experimental/Calibration.h>
#include <Zivid/Experimental/SettingsInfo.h>
#include <Zivid/Zivid.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

// These types are copied as a block, so their layout must be that of the interface.
static_assert(sizeof(Zivid::PointXYZ) == 3 * sizeof(float), "a point is three floats");
static_assert(sizeof(Zivid::ColorRGBA_SRGB) == 4, "a colour is four bytes");
static_assert(sizeof(Zivid::SNR) == sizeof(float), "a signal to noise ratio is a float");

using Picture = Zivid::Image<Zivid::ColorRGBA_SRGB>;

struct pz_session {
    Zivid::Application application; // outlives everything else
    std::optional<Zivid::Camera> camera;
    std::vector<std::variant<Zivid::Settings, Zivid::Settings2D>> settings;
    std::optional<Zivid::Frame> frame;
    std::optional<Picture> picture;
    std::vector<Zivid::ColorRGBA_SRGB> colors; // of the last 3D shot; kept, so that its memory is used again
};

namespace {

struct OutOfOrder : std::runtime_error {
    using std::runtime_error::runtime_error;
};

void say(pz_message *message, const std::string &text) {
    const size_t length = std::min(text.size(), sizeof message->text - 1);
    std::memcpy(message->text, text.data(), length);
    message->text[length] = '\0';
}

template <size_t N> void name(char (&target)[N], const std::string &text) {
    if (text.size() >= N) {
        throw std::length_error("a name of the camera is too long: " + text);
    }
    std::memcpy(target, text.c_str(), text.size() + 1);
}

bool is_connected(const Zivid::Camera &camera) {
    return camera.state().status() == Zivid::CameraState::Status::connected;
}

// Makes a call of the SDK. If it throws, the message is that of the SDK, and the status is `usual`, or "gone" if the
// camera is not connected any more.
template <typename Call> pz_status guarded(pz_session *session, pz_status usual, pz_message *message, Call call) {
    try {
        call();
        return PZ_OK;
    } catch (const OutOfOrder &error) {
        say(message, error.what());
        return PZ_OUT_OF_ORDER;
    } catch (const std::exception &error) {
        say(message, Zivid::toString(error));
    } catch (...) {
        say(message, "an error without a description");
    }
    try {
        if (session != nullptr && session->camera && !is_connected(*session->camera)) {
            return PZ_GONE;
        }
    } catch (...) {
        return PZ_GONE; // a camera that cannot even say how it is
    }
    return usual;
}

Zivid::Camera &camera_of(pz_session *session) {
    if (!session->camera) {
        throw OutOfOrder("no camera is open");
    }
    return *session->camera;
}

template <typename Kind> const Kind &settings_of(pz_session *session, uint32_t slot) {
    if (slot >= session->settings.size() || !std::holds_alternative<Kind>(session->settings[slot])) {
        throw OutOfOrder("settings with this number were not loaded");
    }
    return std::get<Kind>(session->settings[slot]);
}

template <typename Duration> double in_ms(const Duration &duration) {
    return std::chrono::duration_cast<std::chrono::duration<double, std::milli>>(duration).count();
}

uint64_t now_ns() {
    // On Linux this clock is CLOCK_MONOTONIC, the clock that the caller uses.
    const auto since = std::chrono::steady_clock::now().time_since_epoch();
    return static_cast<uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(since).count());
}

// Returns the metadata of a scan or picture from the information that the SDK stores with it; the camera is not
// queried.
template <typename Frame> pz_taken taken_of(const Frame &frame, uint64_t exposed_ns, pz_size size) {
    const double throttled_ms = in_ms(frame.info().metrics().throttlingTime().value());
    return {size, exposed_ns, throttled_ms, frame.state().temperature().lens().value()};
}

void pack(const Zivid::ColorRGBA_SRGB *colors, size_t pixels, uint8_t *rgb) {
    for (size_t at = 0; at < pixels; ++at) {
        rgb[3 * at] = colors[at].r, rgb[3 * at + 1] = colors[at].g, rgb[3 * at + 2] = colors[at].b;
    }
}

// Returns why a camera that was found cannot be opened, or PZ_NOT_FOUND if the reason is not known. The reason is
// written to `text`.
pz_status why_not(Zivid::Application &application, const char *serial, std::string &text) {
    using Status = Zivid::CameraState::Status;
    for (auto &camera : application.cameras()) {
        const auto number = camera.info().serialNumber().toString();
        if (serial != nullptr && number != serial) {
            continue;
        }
        const auto status = camera.state().status();
        const std::string who = "camera " + number;
        if (status == Status::busy) {
            text = who + " is connected to another program or computer";
            return PZ_IN_USE;
        }
        if (status == Status::inaccessible) {
            text = who + " was detected on the network, but its address cannot be reached from this computer";
            return PZ_OUT_OF_REACH;
        }
        if (status == Status::firmwareUpdateRequired || !Zivid::Firmware::isUpToDate(camera)) {
            text = who + " has firmware " + camera.info().firmwareVersion().toString() + ", which is not the one of SDK " +
                   Zivid::Version::coreLibraryVersion();
            return PZ_FIRMWARE;
        }
    }
    return PZ_NOT_FOUND;
}

template <typename Settings>
pz_status read_settings(pz_session *session, const char *file, uint32_t *slot, pz_size *size, pz_message *message) {
    return guarded(session, PZ_SETTINGS, message, [&] {
        auto &camera = camera_of(session);
        Settings settings(file);
        if constexpr (std::is_same_v<Settings, Zivid::Settings>) {
            if (!settings.color().hasValue()) {
                throw std::runtime_error("these settings have no Color part: a 3D shot is taken with its colours");
            }
        }
        const auto resolution = Zivid::Experimental::SettingsInfo::resolution(camera.info(), settings);
        *size = {resolution.width(), resolution.height()};
        *slot = static_cast<uint32_t>(session->settings.size());
        session->settings.emplace_back(std::move(settings));
    });
}

} // namespace

extern "C" {

uint32_t pz_interface(void) {
    return PZ_INTERFACE;
}

pz_session *pz_begin(char sdk[PZ_NAME_BYTES], pz_message *message) {
    pz_session *session = nullptr;
    guarded(nullptr, PZ_NOT_FOUND, message, [&] {
        char version[PZ_NAME_BYTES];
        name(version, Zivid::Version::coreLibraryVersion());
        session = new pz_session();
        std::memcpy(sdk, version, sizeof version);
    });
    return session;
}

void pz_end(pz_session *session) {
    pz_message ignored;
    guarded(session, PZ_GONE, &ignored, [&] {
        if (session->camera) {
            session->camera->disconnect();
        }
    });
    delete session;
}

pz_status pz_connect(pz_session *session, const char *serial, const char *file, pz_identity *identity,
                     pz_message *message) {
    if (session->camera) {
        pz_message ignored; // it may be gone, which is why it is opened again
        guarded(session, PZ_GONE, &ignored, [&] { session->camera->disconnect(); });
        session->camera.reset();
    }
    session->frame.reset();
    session->picture.reset();
    session->settings.clear();
    auto &application = session->application;
    const pz_status connected = guarded(session, PZ_NOT_FOUND, message, [&] {
        if (file != nullptr) {
            session->camera = application.createFileCamera(file);
        } else {
            session->camera = serial == nullptr ? application.connectCamera()
                                                : application.connectCamera(Zivid::CameraInfo::SerialNumber{serial});
        }
    });
    if (connected != PZ_OK) {
        pz_status why = connected;
        std::string text;
        pz_message ignored; // where even looking for the reason fails, the first message stands
        guarded(nullptr, connected, &ignored, [&] { why = file == nullptr ? why_not(application, serial, text) : connected; });
        if (!text.empty()) {
            say(message, text + ". Message of the SDK: " + message->text);
        }
        return why;
    }
    return guarded(session, PZ_NOT_FOUND, message, [&] {
        const auto info = session->camera->info();
        name(identity->serial, info.serialNumber().toString());
        name(identity->model, info.modelName().toString());
    });
}

pz_status pz_settings_scan(pz_session *session, const char *file, uint32_t *slot, pz_size *size, pz_message *message) {
    return read_settings<Zivid::Settings>(session, file, slot, size, message);
}

pz_status pz_settings_picture(pz_session *session, const char *file, uint32_t *slot, pz_size *size,
                              pz_message *message) {
    return read_settings<Zivid::Settings2D>(session, file, slot, size, message);
}

pz_status pz_scan(pz_session *session, uint32_t slot, pz_taken *taken, pz_message *message) {
    return guarded(session, PZ_NO_SHOT, message, [&] {
        auto &camera = camera_of(session);
        session->frame.reset(); // the SDK keeps two unfinished shots at most
        session->frame = camera.capture2D3D(settings_of<Zivid::Settings>(session, slot));
        const uint64_t exposed_ns = now_ns(); // what follows may wait for the computation
        const auto cloud = session->frame->pointCloud();
        *taken = taken_of(*session->frame, exposed_ns, {cloud.width(), cloud.height()});
    });
}

pz_status pz_copy_scan(pz_session *session, float *xyz, uint8_t *rgb, float *snr, size_t pixels, pz_message *message) {
    return guarded(session, PZ_NO_SHOT, message, [&] {
        if (!session->frame) {
            throw OutOfOrder("no scan was captured");
        }
        const auto cloud = session->frame->pointCloud();
        if (cloud.size() != pixels) {
            throw OutOfOrder("there is room for " + std::to_string(pixels) + " points, the shot has " +
                             std::to_string(cloud.size()));
        }
        // Points and SNR are copied directly to the caller's memory. Colours are not, because the SDK's colours have a
        // fourth byte.
        cloud.copyData(reinterpret_cast<Zivid::PointXYZ *>(xyz));
        cloud.copyData(reinterpret_cast<Zivid::SNR *>(snr));
        session->colors.resize(pixels);
        cloud.copyData(session->colors.data());
        pack(session->colors.data(), pixels, rgb);
        session->frame.reset();
    });
}

pz_status pz_picture(pz_session *session, uint32_t slot, pz_taken *taken, pz_message *message) {
    return guarded(session, PZ_NO_SHOT, message, [&] {
        auto &camera = camera_of(session);
        session->picture.reset();
        const auto frame = camera.capture2D(settings_of<Zivid::Settings2D>(session, slot));
        const uint64_t exposed_ns = now_ns();
        session->picture = frame.imageRGBA_SRGB();
        *taken = taken_of(frame, exposed_ns, {session->picture->width(), session->picture->height()});
    });
}

pz_status pz_copy_picture(pz_session *session, uint8_t *rgb, size_t pixels, pz_message *message) {
    return guarded(session, PZ_NO_SHOT, message, [&] {
        if (!session->picture) {
            throw OutOfOrder("no picture was captured");
        }
        const size_t found = session->picture->width() * session->picture->height();
        if (found != pixels) {
            throw OutOfOrder("there is room for " + std::to_string(pixels) + " pixels, the picture has " +
                             std::to_string(found));
        }
        pack(session->picture->data(), pixels, rgb);
        session->picture.reset();
    });
}

pz_status pz_intrinsics(pz_session *session, uint32_t slot, pz_lens *lens, pz_message *message) {
    return guarded(session, PZ_NO_SHOT, message, [&] {
        auto &camera = camera_of(session);
        if (slot >= session->settings.size()) {
            throw OutOfOrder("settings with this number were not loaded");
        }
        const auto found = std::visit(
            [&](const auto &settings) { return Zivid::Experimental::Calibration::intrinsics(camera, settings); },
            session->settings[slot]);
        const auto matrix = found.cameraMatrix();
        const auto distortion = found.distortion();
        *lens = {{matrix.fx().value(), matrix.fy().value(), matrix.cx().value(), matrix.cy().value()},
                 {distortion.k1().value(), distortion.k2().value(), distortion.p1().value(), distortion.p2().value(),
                  distortion.k3().value()}};
    });
}

pz_status pz_state(pz_session *session, pz_temperatures *temperatures, pz_message *message) {
    return guarded(session, PZ_GONE, message, [&] {
        const auto state = camera_of(session).state();
        if (!(state.status() == Zivid::CameraState::Status::connected)) {
            throw std::runtime_error("the camera is not connected");
        }
        const auto found = state.temperature();
        *temperatures = {found.dmd().value(), found.general().value(), found.led().value(), found.lens().value(),
                         found.pcb().value()};
    });
}

pz_status pz_light(pz_session *session, pz_flicker *flicker, pz_message *message) {
    return guarded(session, PZ_NO_SHOT, message, [&] {
        const auto light = camera_of(session).measureSceneConditions().ambientLight();
        const auto classification = light.flickerClassification().toString();
        name(flicker->classification, classification);
        name(flicker->frequency, classification == "noFlicker" ? std::string() : light.flickerFrequency().toString());
    });
}

} // extern "C"
