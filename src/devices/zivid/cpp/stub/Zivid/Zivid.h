// Declarations of the calls of the Zivid SDK that panelprep_zivid.cpp makes, and of no others, so that it can be built and
// tested where there is no SDK. Names and meaning are those of the vendor's public samples (SDK 2.17); nothing here is
// the vendor's text. What they do is played by ../play.cpp. Never installed beside the real headers.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

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

template <typename Element> class Array2D {
  public:
    Array2D(size_t width, size_t height) : width_(width), height_(height), elements_(width * height) {}
    size_t width() const { return width_; }
    size_t height() const { return height_; }
    size_t size() const { return elements_.size(); }
    const Element *data() const { return elements_.data(); }
    Element *begin() { return elements_.data(); }

  private:
    size_t width_, height_;
    std::vector<Element> elements_;
};
template <typename Pixel> using Image = Array2D<Pixel>;

// A node of one of the SDK's trees of values.
template <typename Kind> class Value {
  public:
    explicit Value(Kind value) : value_(std::move(value)) {}
    const Kind &value() const { return value_; }

  private:
    Kind value_;
};

class Resolution {
  public:
    Resolution(size_t width, size_t height) : width_(width), height_(height) {}
    size_t width() const { return width_; }
    size_t height() const { return height_; }

  private:
    size_t width_, height_;
};

class Settings2D {
  public:
    explicit Settings2D(const std::string &fileName);
    bool isSubsampled() const { return subsampled_; } // the stub's own

  private:
    bool subsampled_;
};

class Settings {
  public:
    class Color {
      public:
        explicit Color(bool has) : has_(has) {}
        bool hasValue() const { return has_; }

      private:
        bool has_;
    };
    explicit Settings(const std::string &fileName);
    Color color() const { return Color(has_color_); }
    bool isSubsampled() const { return subsampled_; } // the stub's own

  private:
    bool has_color_, subsampled_;
};

class CameraInfo {
  public:
    class SerialNumber {
      public:
        explicit SerialNumber(std::string text) : text_(std::move(text)) {}
        const std::string &toString() const { return text_; }

      private:
        std::string text_;
    };
    class ModelName {
      public:
        explicit ModelName(std::string text) : text_(std::move(text)) {}
        const std::string &toString() const { return text_; }

      private:
        std::string text_;
    };
    CameraInfo(std::string serial, std::string model, Resolution full)
        : serial_(std::move(serial)), model_(std::move(model)), full_(full) {}
    Resolution full() const { return full_; } // the stub's own
    SerialNumber serialNumber() const { return SerialNumber(serial_); }
    ModelName modelName() const { return ModelName(model_); }

  private:
    std::string serial_, model_;
    Resolution full_;
};

class CameraState {
  public:
    class Status {
      public:
        enum class ValueType { available, connected, disconnected };
        static constexpr ValueType available = ValueType::available;
        static constexpr ValueType connected = ValueType::connected;
        static constexpr ValueType disconnected = ValueType::disconnected;
        explicit Status(ValueType value) : value_(value) {}
        bool operator==(ValueType other) const { return value_ == other; }
        bool operator!=(ValueType other) const { return value_ != other; }

      private:
        ValueType value_;
    };
    class Temperature {
      public:
        explicit Temperature(double lens) : lens_(lens) {}
        Value<double> dmd() const { return Value<double>(lens_ + 8); }
        Value<double> general() const { return Value<double>(lens_ + 2); }
        Value<double> led() const { return Value<double>(lens_ + 12); }
        Value<double> lens() const { return Value<double>(lens_); }
        Value<double> pcb() const { return Value<double>(lens_ + 15); }

      private:
        double lens_;
    };
    CameraState(Status status, Temperature temperature) : status_(status), temperature_(temperature) {}
    Status status() const { return status_; }
    Temperature temperature() const { return temperature_; }

  private:
    Status status_;
    Temperature temperature_;
};

class FrameInfo {
  public:
    class Metrics {
      public:
        explicit Metrics(std::chrono::microseconds throttling) : throttling_(throttling) {}
        Value<std::chrono::microseconds> throttlingTime() const {
            return Value<std::chrono::microseconds>(throttling_);
        }

      private:
        std::chrono::microseconds throttling_;
    };
    explicit FrameInfo(Metrics metrics) : metrics_(metrics) {}
    Metrics metrics() const { return metrics_; }

  private:
    Metrics metrics_;
};

// What one exposure of the stub's camera is.
struct Played;

class PointCloud {
  public:
    explicit PointCloud(std::shared_ptr<const Played> played) : played_(std::move(played)) {}
    size_t width() const;
    size_t height() const;
    size_t size() const { return width() * height(); }
    Array2D<PointXYZ> copyPointsXYZ() const;
    Array2D<ColorRGBA_SRGB> copyColorsRGBA_SRGB() const;
    Array2D<SNR> copySNRs() const;

  private:
    std::shared_ptr<const Played> played_;
};

class Frame2D {
  public:
    explicit Frame2D(std::shared_ptr<const Played> played) : played_(std::move(played)) {}
    Image<ColorRGBA_SRGB> imageRGBA_SRGB() const;
    FrameInfo info() const;

  private:
    std::shared_ptr<const Played> played_;
};

class Frame {
  public:
    explicit Frame(std::shared_ptr<const Played> played) : played_(std::move(played)) {}
    PointCloud pointCloud() const { return PointCloud(played_); }
    FrameInfo info() const;

  private:
    std::shared_ptr<const Played> played_;
};

struct Scene;

class Camera {
  public:
    explicit Camera(std::shared_ptr<Scene> scene) : scene_(std::move(scene)) {}
    CameraInfo info() const;
    CameraState state() const;
    Frame capture2D3D(const Settings &settings);
    Frame2D capture2D(const Settings2D &settings);
    void disconnect();

  private:
    std::shared_ptr<Scene> scene_;
};

class Application {
  public:
    std::vector<Camera> cameras();
    Camera connectCamera();
    Camera connectCamera(const CameraInfo::SerialNumber &serialNumber);
    Camera createFileCamera(const std::string &fileName);
};

class Version {
  public:
    static std::string coreLibraryVersion();
};

std::string toString(const std::exception &exception);

class CameraIntrinsics {
  public:
    class CameraMatrix {
      public:
        explicit CameraMatrix(const double (&values)[4])
            : fx_(values[0]), fy_(values[1]), cx_(values[2]), cy_(values[3]) {}
        Value<double> fx() const { return Value<double>(fx_); }
        Value<double> fy() const { return Value<double>(fy_); }
        Value<double> cx() const { return Value<double>(cx_); }
        Value<double> cy() const { return Value<double>(cy_); }

      private:
        double fx_, fy_, cx_, cy_;
    };
    class Distortion {
      public:
        Value<double> k1() const { return Value<double>(-0.08); }
        Value<double> k2() const { return Value<double>(0.1); }
        Value<double> k3() const { return Value<double>(-0.02); }
        Value<double> p1() const { return Value<double>(0.0002); }
        Value<double> p2() const { return Value<double>(-0.0001); }
    };
    explicit CameraIntrinsics(CameraMatrix matrix) : matrix_(matrix) {}
    CameraMatrix cameraMatrix() const { return matrix_; }
    Distortion distortion() const { return Distortion(); }

  private:
    CameraMatrix matrix_;
};

} // namespace Zivid
