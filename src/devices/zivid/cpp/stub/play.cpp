// Simulates a camera without the SDK: a small scene that is always the same, and faults at chosen exposures.
//
// A text file describes the camera: a file camera, or the file that PANELPREP_ZIVID_STUB names, which is the camera
// found on the network. Each line is optional; these are the lines with their defaults or with examples:
//
//     serial STUB0001
//     model Zivid Two M70
//     width 1944
//     height 1200
//     lens 35.5                  °C at the first exposure of this process
//     warms 0.25                 °C more at each further exposure
//     light grid50hz 100         kind of flicker, and its frequency in Hz; noFlicker without this line
//     feed /tmp/scene.sock       the pictures come from the process that listens on this socket, see `fed` below
//     status busy                the camera on the network cannot be opened: busy, inaccessible, firmwareUpdateRequired
//     fault 3 hang               fault at the third exposure of this process: hang, crash, throw, gone, missing,
//                                infinite, frozen, half, throttled
//
// The scene, for pixel (u, v) of a picture of width w: f = 1785 w / 1944, z = 700 + 25 sin(6 u / w) + 15 v / w mm,
// plus up to 0.05 mm of noise that differs between exposures (for a file camera it is always the same), x = (u + 0.5 -
// w / 2) z / f, and y in the same way. The first twentieth of the columns on the left has no points, as in the
// projector's shadow.

#include <Zivid/Experimental/Calibration.h>
#include <Zivid/Experimental/SettingsInfo.h>
#include <Zivid/Zivid.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>
#include <thread>
#include <vector>

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

using Zivid::CameraState;

namespace played {

struct Scene {
    std::string serial = "STUB0001", model = "Zivid Two M70";
    Size full = {1944, 1200};
    double lens_c = 35.5, warms_c = 0;
    std::string flicker = "noFlicker", flicker_hz, feed;
    std::map<unsigned, std::string> faults;
    bool is_file = false, is_connected = true;
    CameraState::Status::ValueType unconnected = CameraState::Status::ValueType::available;
};

struct Exposure {
    Size size;
    unsigned noise;
    double lens_c, throttled_ms = 0;
    std::string fault;
    // The points come from the feed, if there is one.
    std::vector<Zivid::PointXYZ> points;
    std::vector<Zivid::ColorRGBA_SRGB> colors;
};

// Gives the simulation access to the private members of the declarations.
struct Inside {
    static Zivid::Image<Zivid::ColorRGBA_SRGB> image(Size size, std::vector<Zivid::ColorRGBA_SRGB> pixels) {
        return {size, std::move(pixels)};
    }
    static Zivid::Resolution resolution(const Zivid::CameraInfo &info, bool is_subsampled) {
        const size_t step = is_subsampled ? 2 : 1;
        return Zivid::Resolution({info.full_.width / step, info.full_.height / step});
    }
    template <typename Settings> static bool is_subsampled(const Settings &settings) {
        return settings.subsampled_;
    }
    static Zivid::CameraInfo info(const Scene &scene) {
        return {scene.serial, scene.model, scene.full};
    }
    static CameraState state(CameraState::Status::ValueType status, double lens_c) {
        return {CameraState::Status(status), CameraState::Temperature(lens_c)};
    }
    static Zivid::FrameInfo frame_info(const Exposure &exposure) {
        const auto throttled = std::chrono::microseconds(static_cast<long>(1000 * exposure.throttled_ms));
        return Zivid::FrameInfo(Zivid::FrameInfo::Metrics(throttled));
    }
    static Zivid::SceneConditions conditions(const Scene &scene) {
        return Zivid::SceneConditions(Zivid::SceneConditions::AmbientLight(scene.flicker, scene.flicker_hz));
    }
    static Zivid::Camera camera(std::shared_ptr<Scene> scene) {
        return Zivid::Camera(std::move(scene));
    }
    static const Scene &scene(const Zivid::Camera &camera) {
        return *camera.scene_;
    }
    static Zivid::CameraIntrinsics lens(const Zivid::Resolution &size) {
        const double width = static_cast<double>(size.width()), height = static_cast<double>(size.height());
        const double f = 1785 * width / 1944;
        using Matrix = Zivid::CameraIntrinsics::CameraMatrix;
        return Zivid::CameraIntrinsics(Matrix({f, f, width / 2 - 0.5, height / 2 - 0.5}));
    }
};

namespace {

// Counted over the whole process: if a camera is opened again, the count continues.
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
            words >> scene->full.width;
        } else if (key == "height") {
            words >> scene->full.height;
        } else if (key == "lens") {
            words >> scene->lens_c;
        } else if (key == "warms") {
            words >> scene->warms_c;
        } else if (key == "feed") {
            words >> scene->feed;
        } else if (key == "light") {
            words >> scene->flicker >> scene->flicker_hz;
        } else if (key == "status") {
            words >> key;
            using Status = CameraState::Status::ValueType;
            const std::map<std::string, Status> known = {{"busy", Status::busy},
                                                         {"inaccessible", Status::inaccessible},
                                                         {"firmwareUpdateRequired", Status::firmwareUpdateRequired}};
            scene->unconnected = known.at(key);
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

// The camera on the network. It is a single object, so that a connection outlives the object that opened it.
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

double lens_c_now(const Scene &scene) {
    return scene.lens_c + scene.warms_c * (shots > 1 ? shots - 1 : 0);
}

void read_all(int from, void *to, size_t bytes) {
    for (char *at = static_cast<char *>(to); bytes > 0;) {
        const ssize_t got = ::read(from, at, bytes);
        if (got <= 0) {
            throw std::runtime_error("the scene's feed ended");
        }
        at += got, bytes -= static_cast<size_t>(got);
    }
}

// Requests one exposure from the feed: sends "3d" or "2d" and a newline. The response is width and height (four bytes
// each in the byte order of this computer), for "3d" all points (x, y, z as float), and then all colours (red, green,
// blue, alpha).
void fed(const Scene &scene, bool is_3d, Exposure &played) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (scene.feed.size() >= sizeof(address.sun_path)) {
        throw std::runtime_error("the feed's name is too long");
    }
    std::copy(scene.feed.begin(), scene.feed.end(), address.sun_path);
    const int connection = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    struct Closed {
        int connection;
        ~Closed() { ::close(connection); }
    } closed{connection};
    const char *wish = is_3d ? "3d\n" : "2d\n";
    if (connection < 0 || ::connect(connection, reinterpret_cast<sockaddr *>(&address), sizeof(address)) != 0 ||
        ::write(connection, wish, 3) != 3) {
        throw std::runtime_error("nobody feeds " + scene.feed);
    }
    uint32_t size[2];
    read_all(connection, size, sizeof(size));
    if (size[0] != played.size.width || size[1] != played.size.height) {
        throw std::runtime_error("the feed has another size");
    }
    const size_t pixels = played.size.width * played.size.height;
    if (is_3d) {
        played.points.resize(pixels);
        read_all(connection, played.points.data(), pixels * sizeof(Zivid::PointXYZ));
    }
    played.colors.resize(pixels);
    read_all(connection, played.colors.data(), pixels * sizeof(Zivid::ColorRGBA_SRGB));
}

std::shared_ptr<const Exposure> expose(Scene &scene, bool subsampled, bool is_3d) {
    if (!scene.is_connected) {
        throw std::runtime_error("the camera is not connected");
    }
    static unsigned last_noise = 0;
    const unsigned number = ++shots;
    const auto planted = scene.faults.find(number);
    auto played = std::make_shared<Exposure>();
    const size_t step = subsampled ? 2 : 1;
    played->size = {scene.full.width / step, scene.full.height / step};
    played->noise = scene.is_file ? 1 : number;
    played->lens_c = lens_c_now(scene);
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
        played->size = {played->size.width / 2, played->size.height / 2};
    } else if (played->fault == "throttled") {
        played->throttled_ms = 2500;
    } else if (played->fault == "frozen") {
        played->noise = last_noise;
    }
    last_noise = played->noise;
    if (!scene.feed.empty()) {
        fed(scene, is_3d, *played);
    }
    return played;
}

unsigned mixed(unsigned number) {
    number ^= number >> 16, number *= 0x7feb352du;
    number ^= number >> 15, number *= 0x846ca68bu;
    return number ^ (number >> 16);
}

void paint(const Exposure &exposure, Zivid::ColorRGBA_SRGB *pixel) {
    if (!exposure.colors.empty()) {
        std::copy(exposure.colors.begin(), exposure.colors.end(), pixel);
        return;
    }
    const auto [width, height] = exposure.size;
    for (size_t v = 0; v < height; ++v) {
        for (size_t u = 0; u < width; ++u) {
            const auto noise = mixed(static_cast<unsigned>(v * width + u) + 77777u * exposure.noise) % 4;
            *pixel++ = {static_cast<uint8_t>(40 + 120 * u / width + noise),
                        static_cast<uint8_t>(50 + 100 * v / height + noise), static_cast<uint8_t>(60 + noise), 255};
        }
    }
}

bool has_version_and(const std::string &file_name, const std::string &key, std::string &text) {
    std::ifstream file(file_name);
    std::ostringstream whole;
    whole << file.rdbuf();
    text = whole.str();
    // The SDK captures no scan if the settings have no acquisition.
    const bool is_empty = text.find("Acquisitions: []") != std::string::npos;
    return file && !is_empty && text.find("__version__:") != std::string::npos && text.find(key) != std::string::npos;
}

bool subsampled(const std::string &text) {
    return text.find("Subsample2x2") != std::string::npos;
}

} // namespace
} // namespace played

namespace Zivid {

using played::Inside;

Settings2D::Settings2D(const std::string &fileName) {
    std::string text;
    if (!played::has_version_and(fileName, "Settings2D:", text)) {
        throw std::runtime_error("this is no Settings2D file");
    }
    subsampled_ = played::subsampled(text);
}

Settings::Settings(const std::string &fileName) {
    std::string text;
    if (!played::has_version_and(fileName, "\nSettings:", text)) {
        throw std::runtime_error("this is no Settings file");
    }
    has_color_ = text.find("Color:") != std::string::npos && text.find("Settings2D:") != std::string::npos;
    subsampled_ = played::subsampled(text);
}

size_t PointCloud::width() const {
    return exposure_->size.width;
}

size_t PointCloud::height() const {
    return exposure_->size.height;
}

void PointCloud::copyData(PointXYZ *destination) const {
    if (!exposure_->points.empty()) {
        std::copy(exposure_->points.begin(), exposure_->points.end(), destination);
        return;
    }
    const auto [width, height] = exposure_->size;
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const double w = static_cast<double>(width), h = static_cast<double>(height), f = 1785 * w / 1944;
    std::vector<double> wave(width);
    for (size_t u = 0; u < width; ++u) {
        wave[u] = 700 + 25 * std::sin(6 * static_cast<double>(u) / w);
    }
    auto *point = destination;
    for (size_t v = 0; v < height; ++v) {
        for (size_t u = 0; u < width; ++u) {
            const auto noise = played::mixed(static_cast<unsigned>(v * width + u) + 99991u * exposure_->noise);
            const double z = wave[u] + 15 * static_cast<double>(v) / w + 0.05 * (noise / 4294967295.0);
            const double x = (static_cast<double>(u) + 0.5 - w / 2) * z / f;
            const double y = (static_cast<double>(v) + 0.5 - h / 2) * z / f;
            const bool is_missing = u < width / 20 || exposure_->fault == "missing";
            *point++ = is_missing ? PointXYZ{nan, nan, nan}
                                  : PointXYZ{static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
        }
    }
    if (exposure_->fault == "infinite") {
        destination[width * height / 2] = {0, 0, std::numeric_limits<float>::infinity()};
    }
}

void PointCloud::copyData(ColorRGBA_SRGB *destination) const {
    played::paint(*exposure_, destination);
}

void PointCloud::copyData(SNR *destination) const {
    for (size_t at = 0; at < size(); ++at) {
        destination[at] = {static_cast<float>(10 + at % 7)};
    }
}

Image<ColorRGBA_SRGB> Frame2D::imageRGBA_SRGB() const {
    std::vector<ColorRGBA_SRGB> pixels(exposure_->size.width * exposure_->size.height);
    played::paint(*exposure_, pixels.data());
    return Inside::image(exposure_->size, std::move(pixels));
}

FrameInfo Frame2D::info() const {
    return Inside::frame_info(*exposure_);
}

FrameInfo Frame::info() const {
    return Inside::frame_info(*exposure_);
}

CameraState Frame2D::state() const {
    return Inside::state(CameraState::Status::ValueType::connected, exposure_->lens_c);
}

CameraState Frame::state() const {
    return Inside::state(CameraState::Status::ValueType::connected, exposure_->lens_c);
}

CameraInfo Camera::info() const {
    return Inside::info(*scene_);
}

CameraState Camera::state() const {
    const auto unconnected = scene_->is_file ? CameraState::Status::ValueType::disappeared : scene_->unconnected;
    const auto status = scene_->is_connected ? CameraState::Status::ValueType::connected : unconnected;
    return Inside::state(status, played::lens_c_now(*scene_));
}

Frame Camera::capture2D3D(const Settings &settings) {
    return Frame(played::expose(*scene_, Inside::is_subsampled(settings), true));
}

Frame2D Camera::capture2D(const Settings2D &settings) {
    return Frame2D(played::expose(*scene_, Inside::is_subsampled(settings), false));
}

SceneConditions Camera::measureSceneConditions() {
    if (!scene_->is_connected) {
        throw std::runtime_error("the camera is not connected");
    }
    return Inside::conditions(*scene_);
}

void Camera::disconnect() {
    scene_->is_connected = false;
}

bool Firmware::isUpToDate(const Camera &camera) {
    return Inside::scene(camera).unconnected != CameraState::Status::ValueType::firmwareUpdateRequired;
}

std::vector<Camera> Application::cameras() {
    const auto scene = played::on_the_network();
    return scene ? std::vector<Camera>{Inside::camera(scene)} : std::vector<Camera>{};
}

Camera Application::connectCamera() {
    const auto scene = played::on_the_network();
    if (!scene) {
        throw std::runtime_error("no camera was found");
    }
    if (scene->is_connected || scene->unconnected != CameraState::Status::ValueType::available) {
        throw std::runtime_error("the camera cannot be connected");
    }
    scene->is_connected = true;
    return Inside::camera(scene);
}

Camera Application::connectCamera(const CameraInfo::SerialNumber &serialNumber) {
    const auto scene = played::on_the_network();
    if (!scene || scene->serial != serialNumber.toString()) {
        throw std::runtime_error("no camera with serial number " + serialNumber.toString() + " was found");
    }
    return connectCamera();
}

Camera Application::createFileCamera(const std::string &fileName) {
    return Inside::camera(played::read(fileName, true));
}

std::string Version::coreLibraryVersion() {
    return "stub of 2.17";
}

std::string toString(const std::exception &exception) {
    return exception.what();
}

namespace Experimental::SettingsInfo {

Resolution resolution(const CameraInfo &info, const Settings &settings) {
    return Inside::resolution(info, Inside::is_subsampled(settings));
}

Resolution resolution(const CameraInfo &info, const Settings2D &settings) {
    return Inside::resolution(info, Inside::is_subsampled(settings));
}

} // namespace Experimental::SettingsInfo
namespace Experimental::Calibration {

CameraIntrinsics intrinsics(const Camera &camera, const Settings &settings) {
    return Inside::lens(SettingsInfo::resolution(camera.info(), settings));
}

CameraIntrinsics intrinsics(const Camera &camera, const Settings2D &settings) {
    return Inside::lens(SettingsInfo::resolution(camera.info(), settings));
}

} // namespace Experimental::Calibration
} // namespace Zivid
