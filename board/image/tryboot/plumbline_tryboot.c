// SPDX-License-Identifier: GPL-2.0 OR MIT
/*
 * Asks the boot firmware of a Raspberry Pi for one try of the other slot.
 *
 * A box that has written its idle slot restarts with the system call
 *
 *     reboot(..., LINUX_REBOOT_CMD_RESTART2, "0 tryboot")
 *
 * where the number is the partition to start from, and 0 means the one that the
 * firmware finds by itself. The firmware must be told before the restart: by its
 * property SET_REBOOT_FLAGS, whose lowest bit asks for one try. It forgets the
 * flag when it starts, so that whatever ends the try leads back to the slot
 * before. The Raspberry Pi's own kernel passes the flag on in its firmware
 * driver; the mainline kernel's driver does not, and keeps the firmware's
 * properties from all programs. This module fills the gap.
 *
 * The kernel calls the reboot notifiers before it shuts down the devices, where
 * the firmware driver announces the restart (NOTIFY_REBOOT): the flag is there
 * before that, as the firmware expects it.
 *
 * On any other restart, and on a computer without this firmware, it does
 * nothing.
 */

#define pr_fmt(fmt) KBUILD_MODNAME ": " fmt

#include <linux/bits.h>
#include <linux/errno.h>
#include <linux/module.h>
#include <linux/notifier.h>
#include <linux/of.h>
#include <linux/reboot.h>
#include <linux/string.h>
#include <soc/bcm2835/raspberrypi-firmware.h>

/* A property of the firmware that the kernel's own list lacks, and its one flag. */
#define SET_REBOOT_FLAGS 0x00038064
#define TRY_ONCE BIT(0)

/* Set by the firmware in the length of a property that it knows. */
#define ANSWERED BIT(31)

static struct rpi_firmware *firmware;

/* What the firmware is sent, and then what it has made of it. */
static struct {
	struct rpi_firmware_property_tag_header header;
	__le32 flags;
} request = {
	.header = {
		.tag = SET_REBOOT_FLAGS,
		.buf_size = sizeof(__le32),
	},
	.flags = cpu_to_le32(TRY_ONCE),
};

/* Whether a restart with this command asks for a try: "PARTITION tryboot". */
static bool asks_for_try(const char *command)
{
	const char *word = command ? strchr(command, ' ') : NULL;

	return word && !strcmp(word, " tryboot");
}

static int before_restart(struct notifier_block *block, unsigned long action,
			  void *command)
{
	int failed;

	if (action != SYS_RESTART || !asks_for_try(command))
		return NOTIFY_DONE;
	failed = rpi_firmware_property_list(firmware, &request, sizeof(request));
	/* The restart goes on: without the flag it leads back to the same slot. */
	if (failed)
		pr_err("the firmware cannot be asked for one try: error %d\n", failed);
	else if (!(request.header.req_resp_size & ANSWERED))
		pr_err("this firmware knows no try: it is too old\n");
	else
		pr_notice("the firmware is asked for one try of the other slot\n");
	return NOTIFY_OK;
}

static struct notifier_block notifier = {
	.notifier_call = before_restart,
};

static int __init start(void)
{
	struct device_node *node = rpi_firmware_find_node();
	int failed;

	if (node) {
		firmware = rpi_firmware_get(node);
		of_node_put(node);
	}
	if (!firmware) {
		pr_info("this computer has no firmware of a Raspberry Pi\n");
		return -ENODEV;
	}
	failed = register_reboot_notifier(&notifier);
	if (failed)
		rpi_firmware_put(firmware);
	return failed;
}

static void __exit stop(void)
{
	unregister_reboot_notifier(&notifier);
	rpi_firmware_put(firmware);
}

module_init(start);
module_exit(stop);

MODULE_DESCRIPTION("Asks the firmware of a Raspberry Pi for one try of the other slot");
MODULE_LICENSE("Dual MIT/GPL");
