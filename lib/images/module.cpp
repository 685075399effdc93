// SPDX-License-Identifier: Apache-2.0
// The one symbol by which the program finds the functions of this module.
#include "lib/images/images.h"

extern "C" {
extern const gs::ImageModule gsapp_images;
const gs::ImageModule gsapp_images{gs::images::read_info, gs::images::read, gs::images::encode, gs::images::encode_jpeg,
                                   gs::images::encode_upright};
}
