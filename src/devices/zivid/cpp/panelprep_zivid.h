/* The C interface between Panelprep's camera worker and the Zivid SDK, which is C++.
 *
 * Only one camera and one thread at a time are permitted. No function throws an exception: every call returns a
 * pz_status and, if the status is not PZ_OK, a message. All memory belongs to the caller. Lengths are in mm, times in
 * ms, temperatures in degrees Celsius; NaN if the camera does not report the value. A missing point is NaN. Colours are
 * sRGB.
 *
 * src/devices/zivid/library.rs declares the same interface. Increase PZ_INTERFACE in both files after each change.
 */
#ifndef PANELPREP_ZIVID_H
#define PANELPREP_ZIVID_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PZ_INTERFACE 2u
#define PZ_NAME_BYTES 64
#define PZ_MESSAGE_BYTES 1024

typedef int32_t pz_status;
enum {
    PZ_OK = 0,
    PZ_NOT_FOUND = 1,     /* the camera was not found */
    PZ_GONE = 2,          /* the connection to the open camera was lost */
    PZ_NO_SHOT = 3,       /* the camera delivered no data; another attempt may succeed */
    PZ_SETTINGS = 4,      /* the SDK does not accept the settings */
    PZ_OUT_OF_ORDER = 5,  /* another call is required first */
    PZ_FIRMWARE = 6,      /* the camera was found, but its firmware does not match the SDK */
    PZ_IN_USE = 7,        /* the camera was found, but is connected to another program or computer */
    PZ_OUT_OF_REACH = 8   /* the camera was detected, but its address is in another subnet */
};

typedef struct { char text[PZ_MESSAGE_BYTES]; } pz_message;
typedef struct { char serial[PZ_NAME_BYTES]; char model[PZ_NAME_BYTES]; } pz_identity;
typedef struct { uint64_t width; uint64_t height; } pz_size;

/* The metadata of a scan or picture. */
typedef struct {
    pz_size size;
    uint64_t exposed_ns;  /* end of the exposure on CLOCK_MONOTONIC */
    double throttled_ms;  /* pause because the camera was too hot */
    double lens_c;        /* temperature of the lens at the exposure */
} pz_taken;

typedef struct { double dmd_c, general_c, led_c, lens_c, pcb_c; } pz_temperatures;

/* The lens model: fx, fy, cx, cy in px, and the distortion coefficients k1, k2, p1, p2, k3. */
typedef struct { double matrix_px[4]; double distortion[5]; } pz_lens;

/* The flicker of the ambient light as the SDK classifies it (noFlicker, grid50hz, grid60hz, otherFlicker,
 * unknownFlicker), and its frequency, if the SDK reports one. */
typedef struct { char classification[PZ_NAME_BYTES]; char frequency[PZ_NAME_BYTES]; } pz_flicker;

/* A session: the SDK, the open camera, the loaded settings, and the last scan or picture. */
typedef struct pz_session pz_session;

/* Returns PZ_INTERFACE of this library; called before any other function. */
uint32_t pz_interface(void);

/* Starts the SDK and returns its version in `sdk`. Returns null and a message if the SDK cannot be started. */
pz_session *pz_begin(char sdk[PZ_NAME_BYTES], pz_message *message);
void pz_end(pz_session *session);

/* Opens a camera: by its serial number, from a file, or, if both are null, the only camera that is found. A camera that
 * this session has open is disconnected first. A camera that another program has open is PZ_IN_USE. */
pz_status pz_connect(pz_session *session, const char *serial, const char *file, pz_identity *identity,
                     pz_message *message);

/* Loads settings from a YAML file, for a 3D scan with colour or for a picture; `slot` identifies them afterwards. */
pz_status pz_settings_scan(pz_session *session, const char *file, uint32_t *slot, pz_size *size, pz_message *message);
pz_status pz_settings_picture(pz_session *session, const char *file, uint32_t *slot, pz_size *size,
                              pz_message *message);

/* Captures a 3D scan with colour; returns at the end of the exposure. The next function copies the data, and may have
 * to wait for the computation. */
pz_status pz_scan(pz_session *session, uint32_t slot, pz_taken *taken, pz_message *message);
/* Copies the last scan row by row: x, y, z; red, green, blue; and the signal to noise ratio. `pixels` is the number of
 * pixels for which the caller has memory; if the scan has another number, the status is PZ_OUT_OF_ORDER. */
pz_status pz_copy_scan(pz_session *session, float *xyz, uint8_t *rgb, float *snr, size_t pixels, pz_message *message);

/* Captures a picture, and copies the last picture. */
pz_status pz_picture(pz_session *session, uint32_t slot, pz_taken *taken, pz_message *message);
pz_status pz_copy_picture(pz_session *session, uint8_t *rgb, size_t pixels, pz_message *message);

pz_status pz_intrinsics(pz_session *session, uint32_t slot, pz_lens *lens, pz_message *message);
pz_status pz_state(pz_session *session, pz_temperatures *temperatures, pz_message *message);
/* Measures the flicker of the ambient light, which needs an exposure. */
pz_status pz_light(pz_session *session, pz_flicker *flicker, pz_message *message);

#ifdef __cplusplus
}
#endif
#endif
