/* The C interface between Panelprep's camera worker and the Zivid SDK, which is C++.
 *
 * One camera at a time, one thread at a time. No exception leaves; every call gives a pz_status and, where that is not
 * PZ_OK, a message. Memory belongs to the caller. Lengths are mm, times ms, temperatures degrees Celsius, NaN where
 * the camera does not tell. A missing point is NaN. Colours are sRGB.
 *
 * src/devices/zivid/library.rs declares the same. Whoever changes either counts PZ_INTERFACE up in both.
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
    PZ_NOT_FOUND = 1,     /* no such camera */
    PZ_GONE = 2,          /* it was open and is no longer connected */
    PZ_NO_SHOT = 3,       /* it gave no shot; the next one may be good */
    PZ_SETTINGS = 4,      /* the settings are not ones that the SDK takes */
    PZ_OUT_OF_ORDER = 5,  /* the call needs another one before */
    PZ_FIRMWARE = 6,      /* it is there, and its firmware is not the SDK's */
    PZ_IN_USE = 7,        /* it is there, and connected elsewhere */
    PZ_OUT_OF_REACH = 8   /* it is seen, and its address cannot be reached: another subnet */
};

typedef struct { char text[PZ_MESSAGE_BYTES]; } pz_message;
typedef struct { char serial[PZ_NAME_BYTES]; char model[PZ_NAME_BYTES]; } pz_identity;
typedef struct { uint64_t width; uint64_t height; } pz_size;

/* How a shot was taken. */
typedef struct {
    pz_size size;
    uint64_t exposed_ns;  /* when the acquisition was over, on CLOCK_MONOTONIC */
    double throttled_ms;  /* how long the camera paused because it is hot */
    double lens_c;        /* temperature of the lens at this shot */
} pz_taken;

typedef struct { double dmd_c, general_c, led_c, lens_c, pcb_c; } pz_temperatures;

/* fx, fy, cx, cy in px; k1, k2, p1, p2, k3. */
typedef struct { double matrix_px[4]; double distortion[5]; } pz_lens;

/* What the camera finds of the light around it, in the SDK's words: noFlicker, grid50hz, grid60hz, otherFlicker,
 * unknownFlicker; and how often it flickers a second, where the SDK says so. */
typedef struct { char classification[PZ_NAME_BYTES]; char frequency[PZ_NAME_BYTES]; } pz_flicker;

/* Everything that is open: the SDK, the camera, settings, the last shot. */
typedef struct pz_session pz_session;

/* PZ_INTERFACE of this library; asked before anything else. */
uint32_t pz_interface(void);

/* Starts the SDK; gives its version. Null where that fails, with the message. */
pz_session *pz_begin(char sdk[PZ_NAME_BYTES], pz_message *message);
void pz_end(pz_session *session);

/* Opens a camera: by serial number, from a file, or, where both are null, the only one found. One that this session has
 * open is disconnected first; one that another program has is PZ_IN_USE. */
pz_status pz_connect(pz_session *session, const char *serial, const char *file, pz_identity *identity,
                     pz_message *message);

/* Reads settings from a YAML file for a 3D shot with colour, or for a picture; `slot` names them from then on. */
pz_status pz_settings_scan(pz_session *session, const char *file, uint32_t *slot, pz_size *size, pz_message *message);
pz_status pz_settings_picture(pz_session *session, const char *file, uint32_t *slot, pz_size *size,
                              pz_message *message);

/* Takes a 3D shot with colour; returns when the acquisition is over. The data are copied by the next call, which may wait
 * for the computation. */
pz_status pz_scan(pz_session *session, uint32_t slot, pz_taken *taken, pz_message *message);
/* Copies the last shot row by row: x, y, z, then red, green, blue, then the signal to noise ratio. `pixels` is what the
 * caller has room for; another size is PZ_OUT_OF_ORDER. */
pz_status pz_copy_scan(pz_session *session, float *xyz, uint8_t *rgb, float *snr, size_t pixels, pz_message *message);

/* Takes a picture, and copies it. */
pz_status pz_picture(pz_session *session, uint32_t slot, pz_taken *taken, pz_message *message);
pz_status pz_copy_picture(pz_session *session, uint8_t *rgb, size_t pixels, pz_message *message);

pz_status pz_intrinsics(pz_session *session, uint32_t slot, pz_lens *lens, pz_message *message);
pz_status pz_state(pz_session *session, pz_temperatures *temperatures, pz_message *message);
/* Looks at the light as it is now; exposes for that. */
pz_status pz_light(pz_session *session, pz_flicker *flicker, pz_message *message);

#ifdef __cplusplus
}
#endif
#endif
