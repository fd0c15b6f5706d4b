//! Colour maps as tables of sRGB levels.
//!
//! The tables are those that matplotlib 3.11 publishes (`_cm_listed.py`, CC0): viridis by Smith, van der Walt 2015,
//! cividis by Nuñez, Anderton, Renslow 2018, turbo by Mikhailov 2019; coolwarm is the diverging map of Moreland 2009,
//! tab20 Tableau's.

use surfel_model::Colormap;

const VIRIDIS: [&str; 15] = [
    "44015444025645045745055946075a46085c460a5d460b5e470d60470e6147106347116447136548146748166848176948186a481a6c",
    "481b6d481c6e481d6f481f70482071482173482374482475482576482677482878482979472a7a472c7a472d7b472e7c472f7d46307e",
    "46327e46337f463480453581453781453882443983443a83443b84433d84433e85423f85424086424186414287414487404588404688",
    "3f47883f48893e49893e4a893e4c8a3d4d8a3d4e8a3c4f8a3c508b3b518b3b528b3a538b3a548c39558c39568c38588c38598c375a8c",
    "375b8d365c8d365d8d355e8d355f8d34608d34618d33628d33638d32648e32658e31668e31678e31688e30698e306a8e2f6b8e2f6c8e",
    "2e6d8e2e6e8e2e6f8e2d708e2d718e2c718e2c728e2c738e2b748e2b758e2a768e2a778e2a788e29798e297a8e297b8e287c8e287d8e",
    "277e8e277f8e27808e26818e26828e26828e25838e25848e25858e24868e24878e23888e23898e238a8d228b8d228c8d228d8d218e8d",
    "218f8d21908d21918c20928c20928c20938c1f948c1f958b1f968b1f978b1f988b1f998a1f9a8a1e9b8a1e9c891e9d891f9e891f9f88",
    "1fa0881fa1881fa1871fa28720a38620a48621a58521a68522a78522a88423a98324aa8325ab8225ac8226ad8127ad8128ae8029af7f",
    "2ab07f2cb17e2db27d2eb37c2fb47c31b57b32b67a34b67935b77937b87838b9773aba763bbb753dbc743fbc7340bd7242be7144bf70",
    "46c06f48c16e4ac16d4cc26c4ec36b50c46a52c56954c56856c66758c7655ac8645cc8635ec96260ca6063cb5f65cb5e67cc5c69cd5b",
    "6ccd5a6ece5870cf5773d05675d05477d1537ad1517cd2507fd34e81d34d84d44b86d54989d5488bd6468ed64590d74393d74195d840",
    "98d83e9bd93c9dd93ba0da39a2da37a5db36a8db34aadc32addc30b0dd2fb2dd2db5de2bb8de29bade28bddf26c0df25c2df23c5e021",
    "c8e020cae11fcde11dd0e11cd2e21bd5e21ad8e219dae319dde318dfe318e2e418e5e419e7e419eae51aece51befe51cf1e51df4e61e",
    "f6e620f8e621fbe723fde725",
];

const CIVIDIS: [&str; 15] = [
    "00224e00234f00245100255300255400265600275800285900285b00295d002a5f002a61002b62002c64002c66002d68002e6a002e6c",
    "002f6d00306f0030700031700031710132710533710833700c34700f357012357014367016377018376f1a386f1c396f1e3a6f203a6f",
    "213b6e233c6e243c6e263d6e273e6e293f6e2a3f6d2b406d2d416d2e416d2f426d31436d32436d33446d34456c35456c36466c38476c",
    "39486c3a486c3b496c3c4a6c3d4a6c3e4b6c3f4c6c404c6c414d6c424e6c434e6c444f6c45506c46516c47516c48526c49536c4a536c",
    "4b546c4c556c4d556c4e566c4f576c50576c51586d52596d535a6d545a6d555b6d555c6d565c6d575d6d585e6d595e6e5a5f6e5b606e",
    "5c616e5d616e5e626e5e636f5f636f60646f61656f62656f636670646770656870656870666970676a71686a71696b716a6c716b6d72",
    "6c6d726c6e726d6f726e6f736f70737071737172747272747273747374757474757575757676767777767777777878777979777a7a78",
    "7b7a787c7b787d7c787e7c787e7d787f7e78807f78817f788280798381798482798582798683798784788885788985788a86788b8778",
    "8c88788d88788e89788f8a78908b78918b78928c78928d78938e78948e77958f779690779791779892779992779a93769b94769c9576",
    "9d95769e96769f9775a09875a19975a29975a39a74a49b74a59c74a69c74a79d73a89e73a99f73aaa073aba072aca172ada272aea371",
    "afa471b0a571b1a570b3a670b4a76fb5a86fb6a96fb7a96eb8aa6eb9ab6dbaac6dbbad6dbcae6cbdae6cbeaf6bbfb06bc0b16ac1b26a",
    "c2b369c3b369c4b468c5b568c6b667c7b767c8b866c9b965cbb965ccba64cdbb63cebc63cfbd62d0be62d1bf61d2c060d3c05fd4c15f",
    "d5c25ed6c35dd7c45cd9c55cdac65bdbc75adcc859ddc858dec958dfca57e0cb56e1cc55e2cd54e4ce53e5cf52e6d051e7d150e8d24f",
    "e9d34eead34cebd44bedd54aeed649efd748f0d846f1d945f2da44f3db42f5dc41f6dd3ff7de3ef8df3cf9e03afbe138fce236fde334",
    "fee434fee535fee636fee838",
];

const TURBO: [&str; 15] = [
    "30123b32154333184a341b51351e5836215f37246638276d392a733a2d793b2f803c32863d358b3e38913f3b973f3e9c4040a24143a7",
    "4146ac4249b1424bb5434eba4451bf4454c34456c74559cb455ccf455ed34661d64664da4666dd4669e0466be3476ee64771e94773eb",
    "4776ee4778f0477bf2467df44680f64682f84685fa4687fb458afc458cfd448ffe4391fe4294ff4196ff4099ff3e9bfe3d9efe3ba0fd",
    "3aa3fc38a5fb37a8fa35abf833adf731aff52fb2f42eb4f22cb7f02ab9ee28bceb27bee925c0e723c3e422c5e220c7df1fc9dd1ecbda",
    "1ccdd81bd0d51ad2d21ad4d019d5cd18d7ca18d9c818dbc518ddc218dec018e0bd19e2bb19e3b91ae4b61ce6b41de7b21fe9af20eaac",
    "22ebaa25eca727eea42aefa12cf09e2ff19b32f29835f39438f4913cf58e3ff68a43f78746f8844af8804ef97d52fa7a55fa7659fb73",
    "5dfc6f61fc6c65fd6969fd666dfe6271fe5f75fe5c79fe597dff5680ff5384ff5188ff4e8bff4b8fff4992ff4796fe4499fe429cfe40",
    "9ffd3fa1fd3da4fc3ca7fc3aa9fb39acfb38affa37b1f936b4f836b7f735b9f635bcf534bef434c1f334c3f134c6f034c8ef34cbed34",
    "cdec34d0ea34d2e935d4e735d7e535d9e436dbe236dde037dfdf37e1dd37e3db38e5d938e7d739e9d539ebd339ecd13aeecf3aefcd3a",
    "f1cb3af2c93af4c73af5c53af6c33af7c13af8be39f9bc39faba39fbb838fbb637fcb336fcb136fdae35fdac34fea933fea732fea431",
    "fea130fe9e2ffe9b2dfe992cfe962bfe932afe9029fd8d27fd8a26fc8725fc8423fb8122fb7e21fa7b1ff9781ef9751df8721cf76f1a",
    "f66c19f56918f46617f36315f26014f15d13f05b12ef5811ed5510ec530feb500eea4e0de84b0ce7490ce5470be4450ae2430ae14109",
    "df3f08dd3d08dc3b07da3907d83706d63506d43305d23105d02f05ce2d04cc2b04ca2a04c82803c52603c32503c12302be2102bc2002",
    "b91e02b71d02b41b01b21a01af1801ac1701a91601a71401a41301a112019e10019b0f01980e01950d01920b018e0a018b0902880802",
    "8507028106027e05027a0403",
];

const COOLWARM: [&str; 15] = [
    "3b4cc03c4ec23d50c33e51c53f53c64055c84257c94358cb445acc455cce465ecf485fd14961d24a63d34b64d54c66d64e68d84f69d9",
    "506bda516ddb536edd5470de5572df5673e05875e15977e35a78e45b7ae55d7ce65e7de75f7fe86180e96282ea6384eb6485ec6687ed",
    "6788ee688aef6a8bef6b8df06c8ff16e90f26f92f37093f37295f47396f57597f67699f6779af7799cf87a9df87b9ff97da0f97ea1fa",
    "80a3fa81a4fb82a6fb84a7fc85a8fc86a9fc88abfd89acfd8badfd8caffe8db0fe8fb1fe90b2fe92b4fe93b5fe94b6ff96b7ff97b8ff",
    "98b9ff9abbff9bbcff9dbdff9ebeff9fbfffa1c0ffa2c1ffa3c2fea5c3fea6c4fea7c5fea9c6fdaac7fdabc8fdadc9fdaec9fcafcafc",
    "b1cbfcb2ccfbb3cdfbb5cdfab6cefab7cff9b9d0f9bad0f8bbd1f8bcd2f7bed2f6bfd3f6c0d4f5c1d4f4c3d5f4c4d5f3c5d6f2c6d6f1",
    "c7d7f0c9d7f0cad8efcbd8eeccd9edcdd9eccedaebcfdaead1dae9d2dbe8d3dbe7d4dbe6d5dbe5d6dce4d7dce3d8dce2d9dce1dadce0",
    "dbdcdedcdddddddcdcdedcdbdfdbd9e0dbd8e1dad6e2dad5e3d9d3e4d9d2e5d8d1e6d7cfe7d7cee8d6cce9d5cbead5c9ead4c8ebd3c6",
    "ecd3c5edd2c3edd1c2eed0c0efcfbfefcebdf0cdbbf1cdbaf1ccb8f2cbb7f2cab5f2c9b4f3c8b2f3c7b1f4c6aff4c5adf5c4acf5c2aa",
    "f5c1a9f5c0a7f6bfa6f6bea4f6bda2f7bca1f7ba9ff7b99ef7b89cf7b79bf7b599f7b497f7b396f7b194f7b093f7af91f7ad90f7ac8e",
    "f7aa8cf7a98bf7a889f7a688f6a586f6a385f6a283f5a081f59f80f59d7ef59c7df49a7bf4987af39778f39577f39475f29274f29072",
    "f18f71f18d6ff08b6ef08a6cef886bee8669ee8468ed8366ec8165ec7f63eb7d62ea7b60e97a5fe9785de8765ce7745be67259e57058",
    "e46e56e36c55e36b54e26952e16751e0654fdf634ede614ddd5f4bdc5d4ada5a49d95847d85646d75445d65244d55042d44e41d24b40",
    "d1493fd0473dcf453ccd423bcc403acb3e38ca3b37c83836c73635c53334c43032c32e31c12b30c0282fbe242ebd1f2dbb1b2cba162b",
    "b8122ab70d28b50927b40426",
];

const TAB20: [&str; 2] = [
    "1f77b4aec7e8ff7f0effbb782ca02c98df8ad62728ff98969467bdc5b0d5",
    "8c564bc49c94e377c2f7b6d27f7f7fc7c7c7bcbd22dbdb8d17becf9edae5",
];

/// Returns the map's colours as sRGB levels: 256 from the least value to the largest, or the 20 colours of tab20.
pub(super) fn levels(map: Colormap) -> Vec<[u8; 3]> {
    match map {
        Colormap::Viridis => table(&VIRIDIS),
        Colormap::Cividis => table(&CIVIDIS),
        Colormap::Turbo => table(&TURBO),
        Colormap::Coolwarm => table(&COOLWARM),
        Colormap::Tab20 => table(&TAB20),
        Colormap::Grey => (0..=255).map(|level| [level; 3]).collect(),
    }
}

fn table(lines: &[&str]) -> Vec<[u8; 3]> {
    let digit = |c: u8| char::from(c).to_digit(16).unwrap_or(0) as u8;
    let digits: Vec<u8> = lines.iter().flat_map(|line| line.bytes()).map(digit).collect();
    let level = |pair: &[u8]| pair[0] * 16 + pair[1];
    digits.chunks_exact(6).map(|c| [level(&c[..2]), level(&c[2..4]), level(&c[4..])]).collect()
}

/// Returns name and colour of a class of ASPRS's LAS 1.4 R15, table 17. The colours are Surfel's: ASPRS defines none.
pub(super) fn class(number: f64) -> Option<(&'static str, [u8; 3])> {
    let classes: [(&str, [u8; 3]); 23] = [
        ("never classified", [186, 186, 186]),
        ("unclassified", [170, 170, 170]),
        ("ground", [170, 110, 50]),
        ("low vegetation", [170, 220, 110]),
        ("medium vegetation", [90, 190, 70]),
        ("high vegetation", [20, 130, 40]),
        ("building", [225, 80, 70]),
        ("low noise", [150, 0, 30]),
        ("reserved", [110, 110, 110]),
        ("water", [60, 140, 230]),
        ("rail", [140, 80, 160]),
        ("road surface", [70, 70, 80]),
        ("reserved", [90, 90, 90]),
        ("wire guard", [250, 240, 120]),
        ("wire conductor", [250, 220, 50]),
        ("transmission tower", [240, 170, 40]),
        ("wire connector", [210, 190, 90]),
        ("bridge deck", [120, 150, 190]),
        ("high noise", [200, 0, 110]),
        ("overhead structure", [250, 150, 170]),
        ("ignored ground", [205, 170, 125]),
        ("snow", [235, 245, 255]),
        ("temporal exclusion", [130, 130, 60]),
    ];
    (number.fract() == 0.0 && number >= 0.0).then_some(())?;
    classes.get(number as usize).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_have_the_published_values() {
        for map in Colormap::ALL {
            assert_eq!(levels(map).len(), if map == Colormap::Tab20 { 20 } else { 256 }, "{map:?}");
        }
        // First, a middle and the last entry of each published table.
        for (map, [first, middle, last]) in [
            (Colormap::Viridis, [[68, 1, 84], [33, 145, 140], [253, 231, 37]]),
            (Colormap::Cividis, [[0, 34, 78], [125, 124, 120], [254, 232, 56]]),
            (Colormap::Turbo, [[48, 18, 59], [164, 252, 60], [122, 4, 3]]),
            (Colormap::Coolwarm, [[59, 76, 192], [221, 220, 220], [180, 4, 38]]),
            (Colormap::Grey, [[0; 3], [128; 3], [255; 3]]),
        ] {
            let levels = levels(map);
            assert_eq!([levels[0], levels[128], levels[255]], [first, middle, last], "{map:?}");
        }
        let tab20 = levels(Colormap::Tab20);
        assert_eq!((tab20[0], tab20[19]), ([31, 119, 180], [158, 218, 229]));
    }

    #[test]
    fn classes_are_those_of_the_standard() {
        assert_eq!(class(2.0).map(|c| c.0), Some("ground"));
        assert_eq!(class(22.0).map(|c| c.0), Some("temporal exclusion"));
        assert_eq!([23.0, -1.0, 2.5, f64::NAN, f64::INFINITY].map(class), [None; 5]);
    }
}
