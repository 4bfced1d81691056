// A stub of the Zivid SDK. It declares only the calls that panelprep_zivid.cpp makes, so that this file can be compiled
// and tested without the SDK. Names and meaning are those of the vendor's public samples (SDK 2.17, see
// ../../CALLS.md); nothing here is copied from the vendor. All public names in the namespace Zivid also exist in the
// SDK; what the stub itself needs is private or in the namespace played. ../play.cpp simulates the calls. The stub is
// never installed together with the real headers.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace played {

struct Scene;    // the camera
struct Exposure; // one exposure of it
struct Inside;   // sees what is private
struct Size {
    size_t width, height;
};

// A leaf (a single value) in one of the SDK's trees of settings.
template <typename Kind> class Leaf {
  public:
    explicit Leaf(Kind value) : value_(std::move(value)) {}
    const Kind &value() const { return value_; }

  private:
    Kind value_;
};
class TextLeaf {
  public:
    explicit TextLeaf(std::string text) : text_(std::move(text)) {}
    const std::string &toString() const { return text_; }

  private:
    std::string text_;
};

} // namespace played

namespace Zivid {

struct PointXYZ {
    float x, y, z; // NaN where missing
};
struct ColorRGBA_SRGB {
    uint8_t r, g, b, a;
};
struct SNR {
    float value;
};

template <typename Pixel> class Image {
  public:
    size_t width() const { return size_.width; }
    size_t height() const { return size_.height; }
    const Pixel *data() const { return pixels_.data(); }

  private:
    friend struct played::Inside;
    Image(played::Size size, std::vector<Pixel> pixels) : size_(size), pixels_(std::move(pixels)) {}
    played::Size size_;
    std::vector<Pixel> pixels_;
};

class Resolution {
  public:
    size_t width() const { return size_.width; }
    size_t height() const { return size_.height; }

  private:
    friend struct played::Inside;
    explicit Resolution(played::Size size) : size_(size) {}
    played::Size size_;
};

class Settings2D {
  public:
    explicit Settings2D(const std::string &fileName);

  private:
    friend struct played::Inside;
    bool subsampled_;
};

class Settings {
  public:
    class Color {
      public:
        bool hasValue() const { return has_; }

      private:
        friend class Settings;
        explicit Color(bool has) : has_(has) {}
        bool has_;
    };
    explicit Settings(const std::string &fileName);
    Color color() const { return Color(has_color_); }

  private:
    friend struct played::Inside;
    bool has_color_, subsampled_;
};

class CameraInfo {
  public:
    class SerialNumber : public played::TextLeaf {
      public:
        using TextLeaf::TextLeaf;
    };
    class ModelName : public played::TextLeaf {
      public:
        using TextLeaf::TextLeaf;
    };
    class FirmwareVersion : public played::TextLeaf {
      public:
        using TextLeaf::TextLeaf;
    };
    SerialNumber serialNumber() const { return SerialNumber(serial_); }
    ModelName modelName() const { return ModelName(model_); }
    FirmwareVersion firmwareVersion() const { return FirmwareVersion("2.17.0+played"); }

  private:
    friend struct played::Inside;
    CameraInfo(std::string serial, std::string model, played::Size full)
        : serial_(std::move(serial)), model_(std::move(model)), full_(full) {}
    std::string serial_, model_;
    played::Size full_;
};

class CameraState {
  public:
    class Status {
      public:
        enum class ValueType {
            available, connecting, connected, disconnecting, busy, inaccessible, disappeared, firmwareUpdateRequired,
            updatingFirmware, applyingNetworkConfiguration
        };
        static constexpr ValueType connected = ValueType::connected;
        static constexpr ValueType busy = ValueType::busy;
        static constexpr ValueType inaccessible = ValueType::inaccessible;
        static constexpr ValueType firmwareUpdateRequired = ValueType::firmwareUpdateRequired;
        bool operator==(ValueType other) const { return value_ == other; }

      private:
        friend struct played::Inside;
        explicit Status(ValueType value) : value_(value) {}
        ValueType value_;
    };
    class Temperature {
      public:
        played::Leaf<double> dmd() const { return played::Leaf<double>(lens_ + 8); }
        played::Leaf<double> general() const { return played::Leaf<double>(lens_ + 2); }
        played::Leaf<double> led() const { return played::Leaf<double>(lens_ + 12); }
        played::Leaf<double> lens() const { return played::Leaf<double>(lens_); }
        played::Leaf<double> pcb() const { return played::Leaf<double>(lens_ + 15); }

      private:
        friend struct played::Inside;
        explicit Temperature(double lens) : lens_(lens) {}
        double lens_;
    };
    Status status() const { return status_; }
    Temperature temperature() const { return temperature_; }

  private:
    friend struct played::Inside;
    CameraState(Status status, Temperature temperature) : status_(status), temperature_(temperature) {}
    Status status_;
    Temperature temperature_;
};

class FrameInfo {
  public:
    class Metrics {
      public:
        played::Leaf<std::chrono::microseconds> throttlingTime() const {
            return played::Leaf<std::chrono::microseconds>(throttling_);
        }

      private:
        friend struct played::Inside;
        explicit Metrics(std::chrono::microseconds throttling) : throttling_(throttling) {}
        std::chrono::microseconds throttling_;
    };
    Metrics metrics() const { return metrics_; }

  private:
    friend struct played::Inside;
    explicit FrameInfo(Metrics metrics) : metrics_(metrics) {}
    Metrics metrics_;
};

class PointCloud {
  public:
    size_t width() const;
    size_t height() const;
    size_t size() const { return width() * height(); }
    void copyData(PointXYZ *destination) const;
    void copyData(ColorRGBA_SRGB *destination) const;
    void copyData(SNR *destination) const;

  private:
    friend class Frame;
    explicit PointCloud(std::shared_ptr<const played::Exposure> exposure) : exposure_(std::move(exposure)) {}
    std::shared_ptr<const played::Exposure> exposure_;
};

class Frame2D {
  public:
    Image<ColorRGBA_SRGB> imageRGBA_SRGB() const;
    FrameInfo info() const;
    CameraState state() const;

  private:
    friend class Camera;
    explicit Frame2D(std::shared_ptr<const played::Exposure> exposure) : exposure_(std::move(exposure)) {}
    std::shared_ptr<const played::Exposure> exposure_;
};

class Frame {
  public:
    PointCloud pointCloud() const { return PointCloud(exposure_); }
    FrameInfo info() const;
    CameraState state() const;

  private:
    friend class Camera;
    explicit Frame(std::shared_ptr<const played::Exposure> exposure) : exposure_(std::move(exposure)) {}
    std::shared_ptr<const played::Exposure> exposure_;
};

class SceneConditions {
  public:
    class AmbientLight {
      public:
        played::TextLeaf flickerClassification() const { return classification_; }
        played::TextLeaf flickerFrequency() const { return frequency_; }

      private:
        friend struct played::Inside;
        AmbientLight(std::string classification, std::string frequency)
            : classification_(std::move(classification)), frequency_(std::move(frequency)) {}
        played::TextLeaf classification_, frequency_;
    };
    AmbientLight ambientLight() const { return light_; }

  private:
    friend struct played::Inside;
    explicit SceneConditions(AmbientLight light) : light_(std::move(light)) {}
    AmbientLight light_;
};

class Camera {
  public:
    CameraInfo info() const;
    CameraState state() const;
    Frame capture2D3D(const Settings &settings);
    Frame2D capture2D(const Settings2D &settings);
    SceneConditions measureSceneConditions();
    void disconnect();

  private:
    friend struct played::Inside;
    explicit Camera(std::shared_ptr<played::Scene> scene) : scene_(std::move(scene)) {}
    std::shared_ptr<played::Scene> scene_;
};

namespace Firmware {
bool isUpToDate(const Camera &camera);
} // namespace Firmware

class Application {
  public:
    std::vector<Camera> cameras();
    Camera connectCamera();
    Camera connectCamera(const CameraInfo::SerialNumber &serialNumber);
    Camera createFileCamera(const std::string &fileName);
};

namespace Version {
std::string coreLibraryVersion();
} // namespace Version

std::string toString(const std::exception &exception);

class CameraIntrinsics {
  public:
    class CameraMatrix {
      public:
        played::Leaf<double> fx() const { return played::Leaf<double>(fx_); }
        played::Leaf<double> fy() const { return played::Leaf<double>(fy_); }
        played::Leaf<double> cx() const { return played::Leaf<double>(cx_); }
        played::Leaf<double> cy() const { return played::Leaf<double>(cy_); }

      private:
        friend struct played::Inside;
        explicit CameraMatrix(const double (&values)[4])
            : fx_(values[0]), fy_(values[1]), cx_(values[2]), cy_(values[3]) {}
        double fx_, fy_, cx_, cy_;
    };
    class Distortion {
      public:
        played::Leaf<double> k1() const { return played::Leaf<double>(-0.08); }
        played::Leaf<double> k2() const { return played::Leaf<double>(0.1); }
        played::Leaf<double> k3() const { return played::Leaf<double>(-0.02); }
        played::Leaf<double> p1() const { return played::Leaf<double>(0.0002); }
        played::Leaf<double> p2() const { return played::Leaf<double>(-0.0001); }
    };
    CameraMatrix cameraMatrix() const { return matrix_; }
    Distortion distortion() const { return Distortion(); }

  private:
    friend struct played::Inside;
    explicit CameraIntrinsics(CameraMatrix matrix) : matrix_(matrix) {}
    CameraMatrix matrix_;
};

} // namespace Zivid
