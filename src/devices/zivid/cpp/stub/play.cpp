// Plays a camera where there is no SDK: a small scene that is the same each time, and faults at chosen shots.
//
// The camera is described by a file of lines: that of a file camera, or the one that PANELPREP_ZIVID_STUB names, which is the
// camera found on the network. Without a line the default holds.
//
//     serial STUB0001
//     model Zivid Two M70
//     width 1944
//     height 1200
//     lens 35.5                  °C
//     fault 3 hang               at the third shot or picture of this process, of: hang, crash, throw, gone, missing,
//                                infinite, frozen, half, throttled
//
// The scene, for pixel (u, v) of a picture of width w: f = 1785 w / 1944, z = 700 + 25 sin(6 u / w) + 15 v / w mm and up to
// 0.05 mm of noise that differs from shot to shot (a file camera's never does), x = (u + 0.5 - w / 2) z / f, y likewise.
// The outermost twentieth of the columns on the left is missing, as by the projector's shadow.

#include <Zivid/Experimental/Calibration.h>
#include <Zivid/Experimental/SettingsInfo.h>
#include <Zivid/Zivid.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace Zivid {

struct Scene {
    std::string serial = "STUB0001", model = "Zivid Two M70";
    size_t width = 1944, height = 1200;
    double lens_c = 35.5;
    std::map<unsigned, std::string> faults;
    bool is_file = false, is_connected = true;
};

struct Played {
    size_t width, height;
    unsigned noise;
    double throttled_ms = 0;
    std::string fault;
};

namespace {

// Counted over the whole process: a camera that is opened again goes on.
unsigned shots = 0;

std::shared_ptr<Scene> read(const std::string &name, bool is_file) {
    std::ifstream file(name);
    if (!file) {
        throw std::runtime_error("there is no camera file " + name);
    }
    auto scene = std::make_shared<Scene>();
    scene->is_file = is_file;
    for (std::string line; std::getline(file, line);) {
        std::istringstream words(line);
        std::string key;
        words >> key;
        if (key == "serial") {
            words >> scene->serial;
        } else if (key == "model") {
            std::getline(words >> std::ws, scene->model);
        } else if (key == "width") {
            words >> scene->width;
        } else if (key == "height") {
            words >> scene->height;
        } else if (key == "lens") {
            words >> scene->lens_c;
        } else if (key == "fault") {
            unsigned at;
            words >> at;
            words >> scene->faults[at];
        } else if (!key.empty()) {
            throw std::runtime_error(name + ": " + key + " is nothing that this camera is described by");
        }
        if (words.fail()) {
            throw std::runtime_error(name + ": " + line);
        }
    }
    return scene;
}

// The camera on the network: one object, so that a connection outlives whoever made it.
std::shared_ptr<Scene> on_the_network() {
    static std::shared_ptr<Scene> scene = [] {
        const char *name = std::getenv("PANELPREP_ZIVID_STUB");
        auto found = name == nullptr ? std::shared_ptr<Scene>() : read(name, false);
        if (found) {
            found->is_connected = false;
        }
        return found;
    }();
    return scene;
}

std::shared_ptr<const Played> expose(Scene &scene, bool subsampled) {
    if (!scene.is_connected) {
        throw std::runtime_error("the camera is not connected");
    }
    static unsigned last_noise = 0;
    const unsigned number = ++shots;
    const auto planted = scene.faults.find(number);
    auto played = std::make_shared<Played>();
    const size_t step = subsampled ? 2 : 1;
    played->width = scene.width / step, played->height = scene.height / step;
    played->noise = scene.is_file ? 1 : number;
    played->fault = planted == scene.faults.end() ? "" : planted->second;
    if (played->fault == "hang") {
        std::this_thread::sleep_for(std::chrono::hours(1));
    } else if (played->fault == "crash") {
        std::abort();
    } else if (played->fault == "throw") {
        throw std::runtime_error("the exposure failed");
    } else if (played->fault == "gone") {
        scene.is_connected = false;
        throw std::runtime_error("the camera does not answer");
    } else if (played->fault == "half") {
        played->width /= 2, played->height /= 2;
    } else if (played->fault == "throttled") {
        played->throttled_ms = 2500;
    } else if (played->fault == "frozen") {
        played->noise = last_noise;
    }
    last_noise = played->noise;
    return played;
}

unsigned mixed(unsigned number) {
    number ^= number >> 16, number *= 0x7feb352du;
    number ^= number >> 15, number *= 0x846ca68bu;
    return number ^ (number >> 16);
}

Array2D<ColorRGBA_SRGB> colors(const Played &played) {
    Array2D<ColorRGBA_SRGB> picture(played.width, played.height);
    auto *pixel = picture.begin();
    for (size_t v = 0; v < played.height; ++v) {
        for (size_t u = 0; u < played.width; ++u) {
            const auto noise = mixed(static_cast<unsigned>(v * played.width + u) + 77777u * played.noise) % 4;
            *pixel++ = {static_cast<uint8_t>(40 + 120 * u / played.width + noise),
                        static_cast<uint8_t>(50 + 100 * v / played.height + noise), static_cast<uint8_t>(60 + noise), 255};
        }
    }
    return picture;
}

bool has_version_and(const std::string &file_name, const std::string &key, std::string &text) {
    std::ifstream file(file_name);
    std::ostringstream whole;
    whole << file.rdbuf();
    text = whole.str();
    return file && text.find("__version__:") != std::string::npos && text.find(key) != std::string::npos;
}

bool subsampled(const std::string &text) {
    return text.find("Subsample2x2") != std::string::npos;
}

} // namespace

Settings2D::Settings2D(const std::string &fileName) {
    std::string text;
    if (!has_version_and(fileName, "Settings2D:", text)) {
        throw std::runtime_error("this is no Settings2D file");
    }
    subsampled_ = subsampled(text);
}

Settings::Settings(const std::string &fileName) {
    std::string text;
    if (!has_version_and(fileName, "\nSettings:", text)) {
        throw std::runtime_error("this is no Settings file");
    }
    has_color_ = text.find("Color:") != std::string::npos && text.find("Settings2D:") != std::string::npos;
    subsampled_ = subsampled(text);
}

size_t PointCloud::width() const {
    return played_->width;
}

size_t PointCloud::height() const {
    return played_->height;
}

Array2D<PointXYZ> PointCloud::copyPointsXYZ() const {
    const size_t width = played_->width, height = played_->height;
    Array2D<PointXYZ> cloud(width, height);
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const double w = static_cast<double>(width), h = static_cast<double>(height), f = 1785 * w / 1944;
    std::vector<double> wave(width);
    for (size_t u = 0; u < width; ++u) {
        wave[u] = 700 + 25 * std::sin(6 * static_cast<double>(u) / w);
    }
    auto *point = cloud.begin();
    for (size_t v = 0; v < height; ++v) {
        for (size_t u = 0; u < width; ++u) {
            const auto noise = mixed(static_cast<unsigned>(v * width + u) + 99991u * played_->noise);
            const double z = wave[u] + 15 * static_cast<double>(v) / w + 0.05 * (noise / 4294967295.0);
            const double x = (static_cast<double>(u) + 0.5 - w / 2) * z / f;
            const double y = (static_cast<double>(v) + 0.5 - h / 2) * z / f;
            const bool is_missing = u < width / 20 || played_->fault == "missing";
            *point++ = is_missing ? PointXYZ{nan, nan, nan}
                                  : PointXYZ{static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
        }
    }
    if (played_->fault == "infinite") {
        cloud.begin()[width * height / 2] = {0, 0, std::numeric_limits<float>::infinity()};
    }
    return cloud;
}

Array2D<ColorRGBA_SRGB> PointCloud::copyColorsRGBA_SRGB() const {
    return colors(*played_);
}

Array2D<SNR> PointCloud::copySNRs() const {
    Array2D<SNR> ratios(played_->width, played_->height);
    for (size_t at = 0; at < ratios.size(); ++at) {
        ratios.begin()[at] = {static_cast<float>(10 + at % 7)};
    }
    return ratios;
}

Image<ColorRGBA_SRGB> Frame2D::imageRGBA_SRGB() const {
    return colors(*played_);
}

static FrameInfo info_of(const Played &played) {
    const auto throttled = std::chrono::microseconds(static_cast<long>(1000 * played.throttled_ms));
    return FrameInfo(FrameInfo::Metrics(throttled));
}

FrameInfo Frame2D::info() const {
    return info_of(*played_);
}

FrameInfo Frame::info() const {
    return info_of(*played_);
}

CameraInfo Camera::info() const {
    return CameraInfo(scene_->serial, scene_->model, Resolution(scene_->width, scene_->height));
}

CameraState Camera::state() const {
    const auto status = scene_->is_connected ? CameraState::Status::connected : CameraState::Status::disconnected;
    return CameraState(CameraState::Status(status), CameraState::Temperature(scene_->lens_c));
}

Frame Camera::capture2D3D(const Settings &settings) {
    return Frame(expose(*scene_, settings.isSubsampled()));
}

Frame2D Camera::capture2D(const Settings2D &settings) {
    return Frame2D(expose(*scene_, settings.isSubsampled()));
}

void Camera::disconnect() {
    scene_->is_connected = false;
}

std::vector<Camera> Application::cameras() {
    const auto scene = on_the_network();
    return scene ? std::vector<Camera>{Camera(scene)} : std::vector<Camera>{};
}

Camera Application::connectCamera() {
    const auto scene = on_the_network();
    if (!scene) {
        throw std::runtime_error("no camera was found");
    }
    if (scene->is_connected) {
        throw std::runtime_error("the camera is in use");
    }
    scene->is_connected = true;
    return Camera(scene);
}

Camera Application::connectCamera(const CameraInfo::SerialNumber &serialNumber) {
    const auto scene = on_the_network();
    if (!scene || scene->serial != serialNumber.toString()) {
        throw std::runtime_error("no camera with serial number " + serialNumber.toString() + " was found");
    }
    return connectCamera();
}

Camera Application::createFileCamera(const std::string &fileName) {
    return Camera(read(fileName, true));
}

std::string Version::coreLibraryVersion() {
    return "stub of 2.17";
}

std::string toString(const std::exception &exception) {
    return exception.what();
}

namespace Experimental {
namespace {

Resolution halved(const Resolution &full, bool is_subsampled) {
    const size_t step = is_subsampled ? 2 : 1;
    return Resolution(full.width() / step, full.height() / step);
}

CameraIntrinsics lens(const Resolution &size) {
    const double width = static_cast<double>(size.width()), height = static_cast<double>(size.height());
    const double f = 1785 * width / 1944;
    return CameraIntrinsics(CameraIntrinsics::CameraMatrix({f, f, width / 2 - 0.5, height / 2 - 0.5}));
}

} // namespace

namespace SettingsInfo {

Resolution resolution(const CameraInfo &info, const Settings &settings) {
    return halved(info.full(), settings.isSubsampled());
}

Resolution resolution(const CameraInfo &info, const Settings2D &settings) {
    return halved(info.full(), settings.isSubsampled());
}

} // namespace SettingsInfo
namespace Calibration {

CameraIntrinsics intrinsics(const Camera &camera, const Settings &settings) {
    return lens(SettingsInfo::resolution(camera.info(), settings));
}

CameraIntrinsics intrinsics(const Camera &camera, const Settings2D &settings) {
    return lens(SettingsInfo::resolution(camera.info(), settings));
}

} // namespace Calibration
} // namespace Experimental
} // namespace Zivid
